from __future__ import annotations

import importlib
import pkgutil

import gcs_autotune
import sitl


def modules():
    for package in (gcs_autotune, sitl):
        yield package.__name__
        for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if not found.name.endswith("__main__"):
                yield found.name


def test_every_public_name_exists_and_every_module_has_a_docstring():
    silent, missing = [], []
    for name in modules():
        module = importlib.import_module(name)
        if not (module.__doc__ or "").strip():
            silent.append(name)
        missing += [f"{name}.{public}" for public in getattr(module, "__all__", ()) if not hasattr(module, public)]
    assert not silent
    assert not missing


def test_every_package_declares_its_public_names():
    rooms = [f.name for f in pkgutil.iter_modules(gcs_autotune.__path__) if f.ispkg]
    assert len(rooms) >= 10
    for room in rooms:
        module = importlib.import_module(f"gcs_autotune.{room}")
        assert module.__all__, room

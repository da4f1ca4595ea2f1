"""Integration in BlueOS: registration (``/register_service``) and actions for Cockpit.

The page's addresses are relative, so BlueOS may show it under ``/extensionv2/...``. STOP is a button on the page and
the space bar. If enabled, it is also offered as an action of Cockpit for a joystick button. The key of this action is
valid only for STOP, and everyone who can read Cockpit's data has it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route

from gcs_autotune import __version__
from gcs_autotune.web.access import JOYSTICK_STOP, Access

__all__ = ["blueos_routes", "cockpit_extras", "registration"]

_NAME = "GCS Autotune"
_PATH = "/extensionv2/gcsautotune"
"""Path at which BlueOS shows an extension of that name."""
_HOME = "https://github.com/gcs-autotune/gcs-autotune"


def registration() -> dict[str, Any]:
    """Return the response of ``/register_service``."""
    return {
        "name": _NAME,
        "description": "Identify and tune a boat or ROV from a short experiment, and test the gains by a step.",
        "icon": "mdi-tune-vertical-variant",
        "company": "gcs_autotune",
        "version": __version__,
        "webpage": _HOME,
        "api": f"{_HOME}/tree/main/docs",
        "new_page": False,
        "avoid_iframes": False,
        "works_in_relative_paths": True,
        "extras": {"cockpit": "/cockpit_extras.json"},
    }


def cockpit_extras(stop_key: str = "") -> dict[str, Any]:
    """Return what Cockpit may show: the page as a widget, and with a *stop_key* also STOP as an action for a button.

    The keys are those of Cockpit 1.18 and later. The action is a cross-site request that a browser sends without a
    preflight, because Cockpit's own program is not a page of the vehicle.
    """
    return {
        "targetSystem": "Cockpit",
        "targetCockpitApiVersion": "1.0.0",
        "widgets": [
            {
                "name": _NAME,
                "iframeUrl": "/",
                "iframeIcon": "/static/icon.svg",
                "version": __version__,
                "useExtensionPathAsBaseUrl": True,
            }
        ],
        "actions": [_stop_action(stop_key)] if stop_key else [],
    }


def _stop_action(stop_key: str) -> dict[str, Any]:
    name = "Autotune: STOP"
    return {
        "id": "gcs-autotune-stop",
        "name": name,
        "type": "http-request",
        "config": {
            "name": name,
            "url": f"http://{{{{ vehicle-address }}}}{_PATH}/{JOYSTICK_STOP}",
            "method": "POST",
            "headers": {},
            "urlParams": {"key": stop_key},
            "body": "",
        },
        "version": __version__,
    }


def blueos_routes(access: Access, stop: Callable[[], bool]) -> list[BaseRoute]:
    """Return the routes. *stop* stops the run and returns whether there is one."""

    async def register(request: Request) -> Response:
        return JSONResponse(registration())

    async def extras(request: Request) -> Response:
        return JSONResponse(cockpit_extras(access.stop_key))

    async def joystick_stop(request: Request) -> Response:
        if not access.may_stop(request.query_params.get("key", "")):
            return JSONResponse({"error": "the key of this STOP request is not the key of this server"}, 403)
        return JSONResponse({"stopping": stop()})

    return [
        Route(f"/{JOYSTICK_STOP}", joystick_stop, methods=["POST"]),
        Route("/register_service", register),
        Route("/cockpit_extras.json", extras),
    ]

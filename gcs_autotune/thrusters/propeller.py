"""Propellers in moving water: K_T(J) and K_Q(J) of Gomes2003, (10)-(17), and bilinear thrust of ZhaoUSV, (4)-(5).

Gomes2003 prints ``K_T`` in (11); its (13) and (17) have the correct ``K_Q``. The two publications regress the ratio
``T/(rho D^4 |n| n)`` on ``J``. At slow rotation this ratio is mostly noise, but has the same weight as at fast
rotation. This module therefore fits the forces themselves. With ``J = V_A/(n D)``, (16) becomes ``T = rho (alpha_1 D^4
|n| n + alpha_2 D^3 |n| V_A)``. This equation is linear in the coefficients, and its noise is that of the measured
force.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import Doubt, Parameter
from gcs_autotune.identify.problems import inverse_of
from gcs_autotune.notebook import Display, Displayed, display_of_fit
from gcs_autotune.rounding import format_number

__all__ = ["OpenWater", "OpenWaterTest", "PropellerFit", "fit_bilinear", "fit_open_water"]

Array = NDArray[np.float64]

TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class OpenWaterTest(Displayed):
    """Runs of one propeller in an open-water test, all arrays (k,).

    - ``n`` [rad/s]: rotation speed.
    - ``V_A`` [m/s]: advance speed.
    - ``T`` [N]: thrust.
    - ``Q`` [N m]: torque, None if not measured.
    """

    n: Array
    V_A: Array
    T: Array
    Q: Array | None = None


@dataclass(frozen=True, slots=True)
class OpenWater:
    """Open-water characteristic of a propeller, ``K_T = sum alpha_i J^i`` and ``K_Q = sum beta_i J^i``.

    - ``alpha``: coefficients of ``K_T``, the constant first.
    - ``beta``: coefficients of ``K_Q``, the constant first. It is empty without torque.
    - ``D`` [m]: diameter.
    - ``rho`` [kg/m^3]: density of the water.

    Coefficients are for revolutions per second, as in Gomes2003 (10)-(12).
    """

    D: float
    rho: float
    alpha: tuple[float, ...]
    beta: tuple[float, ...] = ()

    def K_T(self, J: ArrayLike) -> Array:  # noqa: N802 (the field's own name)
        """Return the thrust coefficient K_T at the advance number *J* (any shape), Gomes2003, (14)."""
        return _polynomial(self.alpha, J)

    def K_Q(self, J: ArrayLike) -> Array:  # noqa: N802
        """Return the torque coefficient K_Q at the advance number *J* (any shape), Gomes2003, (15)."""
        return _polynomial(self.beta, J)

    def efficiency(self, J: ArrayLike) -> Array:
        """Return the efficiency ``T V_A/(2 pi n Q)``, which is ``J K_T/(2 pi K_Q)`` by Gomes2003, (10)-(13)."""
        result: Array = np.asarray(J, dtype=np.float64) * self.K_T(J) / (TURN * self.K_Q(J))
        return result

    def thrust(self, n: ArrayLike, V_A: ArrayLike) -> Array:
        """Return the thrust ``T`` [N] at *n* [rad/s] and *V_A* [m/s], Gomes2003, (16).

        At ``n = 0`` only the ``J^2`` term remains.
        """
        return _force(self.alpha, self.rho, self.D, 4, n, V_A)

    def torque(self, n: ArrayLike, V_A: ArrayLike) -> Array:
        """Return the torque ``Q`` [N m] at *n* [rad/s] and *V_A* [m/s], Gomes2003, (17)."""
        return _force(self.beta, self.rho, self.D, 5, n, V_A)

    def to_dict(self) -> dict[str, Any]:
        """Return the coefficients as data for JSON."""
        return {"schema": 1, "model": "open water", **asdict(self)}


@dataclass(frozen=True, slots=True, eq=False)
class PropellerFit(Displayed):
    """Coefficients fitted to an open-water test.

    - ``kind``: kind of the fit.
    - ``parameters``: coefficients with standard errors.
    - ``noise``: standard deviations of thrust [N] (``T``) and torque [N m] (``Q``).
    - ``model``: open-water characteristic, None for a bilinear fit.
    """

    kind: str
    parameters: Mapping[str, Parameter]
    covariance: Array
    noise: Mapping[str, float]
    model: OpenWater | None = None
    doubts: tuple[Doubt, ...] = ()

    def _display(self) -> Display:
        noise = ", ".join(f"{name} {format_number(std, 3)}" for name, std in self.noise.items())
        title = f"propeller, {self.kind}; standard deviation of one run: {noise}"
        return display_of_fit(title, self.parameters, self.covariance, self.doubts)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as data for JSON."""
        return {
            "schema": 1,
            "kind": self.kind,
            "parameters": {n: {"value": p.value, "unit": p.unit, "std": p.std} for n, p in self.parameters.items()},
            "covariance": self.covariance.tolist(),
            "noise": dict(self.noise),
            "model": None if self.model is None else self.model.to_dict(),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }


def fit_open_water(test: OpenWaterTest, D: float, *, rho: float = 1000.0, degree: int | None = None) -> PropellerFit:
    """Return K_T(J), and K_Q(J) if torque was measured, fitted to *test*.

    Parameters
    ----------
    D : diameter [m].
    rho : density of the water [kg/m^3]; that of sea water is 1025.
    degree : degree of both polynomials: 1 as in Gomes2003 (14)-(15), or 2. None selects it by the Bayesian information
        criterion.

    Raises
    ------
    NotInformative
        There are fewer runs than coefficients, or all runs are at one advance number.
    """
    _check(test)
    degrees = (1, 2) if degree is None else (degree,)
    solved = {name: _best(test, values, D, rho, power, degrees) for name, power, values in _measured(test)}
    parameters: dict[str, Parameter] = {}
    covariance = np.zeros((0, 0))
    for name, (theta, P, _) in solved.items():
        symbol = "alpha" if name == "T" else "beta"
        for i, value in enumerate(theta):
            key = f"{symbol}_{i + 1}"
            parameters[key] = Parameter(key, float(value), "1", math.sqrt(P[i, i]))
        joined = np.zeros((len(covariance) + len(P),) * 2)
        joined[: len(covariance), : len(covariance)], joined[len(covariance) :, len(covariance) :] = covariance, P
        covariance = joined
    coefficients = {name: tuple(float(v) for v in theta) for name, (theta, _, _) in solved.items()}
    model = OpenWater(D, rho, coefficients["T"], coefficients.get("Q", ()))
    noise = {name: s for name, (_, _, s) in solved.items()}
    return PropellerFit("open water", parameters, covariance, noise, model, _doubts(test, parameters))


def fit_bilinear(test: OpenWaterTest) -> PropellerFit:
    """Return a fit of ZhaoUSV (4), ``T = C_n n|n| - C_v V_A |n|``, or (5), ``T = C_T n|n|``, whichever the runs
    support.

    ``n`` is in rad/s, so ``C_n`` and ``C_T`` are in N s^2/rad^2, ``C_v`` in N s^2/(m rad). For bollard pulls only
    (``V_A = 0``), (5) is fitted.

    Raises
    ------
    NotInformative
        There are too few runs.
    """
    _check(test, advance=False)
    full = np.column_stack([test.n * np.abs(test.n), -test.V_A * np.abs(test.n)])
    moving = bool(np.ptp(test.V_A) > 0.0 or np.any(test.V_A != 0.0))
    choices = [(("C_T",), full[:, :1])] + ([(("C_n", "C_v"), full)] if moving else [])
    solved = [(names, *_linear(H, test.T)) for names, H in choices]
    names, theta, P, s, _ = min(solved, key=lambda c: c[-1])
    units = {"C_v": "N s^2/(m rad)"}
    parameters = {
        n: Parameter(n, float(theta[i]), units.get(n, "N s^2/rad^2"), math.sqrt(P[i, i])) for i, n in enumerate(names)
    }
    kind = "bilinear" if len(names) == 2 else "quadratic"
    return PropellerFit(kind, parameters, P, {"T": s}, None, _doubts(test, parameters))


def _polynomial(coefficients: tuple[float, ...], J: ArrayLike) -> Array:
    result: Array = np.polynomial.polynomial.polyval(np.asarray(J, dtype=np.float64), np.array([*coefficients, 0.0]))
    return result


def _columns(n: Array, V_A: Array, rho: float, D: float, power: int, degree: int) -> Array:
    """Return the regressors (k, degree + 1): ``rho D^power J^i |n| n`` without a division by ``n``; *n* in rev/s."""
    columns = [D**power * np.abs(n) * n, D ** (power - 1) * np.abs(n) * V_A]
    if degree == 2:
        columns.append(D ** (power - 2) * np.sign(n) * V_A**2)
    return rho * np.column_stack(columns)


def _force(c: tuple[float, ...], rho: float, D: float, power: int, n: ArrayLike, V_A: ArrayLike) -> Array:
    turns, speed = np.broadcast_arrays(np.asarray(n, dtype=np.float64) / TURN, np.asarray(V_A, dtype=np.float64))
    if not c:
        return np.zeros(turns.shape)
    H = _columns(turns.ravel(), speed.ravel(), rho, D, power, len(c) - 1)
    result: Array = (H @ np.array(c)).reshape(turns.shape)
    return result


def _measured(test: OpenWaterTest) -> list[tuple[str, int, Array]]:
    return [("T", 4, test.T)] + ([] if test.Q is None else [("Q", 5, test.Q)])


def _best(
    test: OpenWaterTest, values: Array, D: float, rho: float, power: int, degrees: tuple[int, ...]
) -> tuple[Array, Array, float]:
    fits = [_linear(_columns(test.n / TURN, test.V_A, rho, D, power, d), values) for d in degrees]
    theta, P, s, _ = min(fits, key=lambda f: f[-1])
    return theta, P, s


def _linear(H: Array, y: Array) -> tuple[Array, Array, float, float]:
    """Return the least-squares estimate, its covariance, the noise and the information criterion."""
    k, p = H.shape
    if k <= p:
        raise NotInformative(f"{k} runs do not determine {p} coefficients with uncertainty. Measure more")
    inverse = inverse_of(H.T @ H)
    theta = inverse @ (H.T @ y)
    rss = float(np.sum((y - H @ theta) ** 2))
    floor = 1e-20 * float(np.sum(y**2)) + 1e-300
    return theta, inverse * rss / (k - p), math.sqrt(rss / (k - p)), k * math.log(max(rss, floor) / k) + p * math.log(k)


def _check(test: OpenWaterTest, *, advance: bool = True) -> None:
    sizes = {len(test.n), len(test.V_A), len(test.T), len(test.T if test.Q is None else test.Q)}
    arrays = [test.n, test.V_A, test.T] + ([] if test.Q is None else [test.Q])
    if len(sizes) > 1 or not all(np.all(np.isfinite(a)) for a in arrays):
        raise NotInformative("an open-water test needs finite numbers n, V_A and T (and Q) for every run")
    turning = test.n != 0.0
    if not np.any(turning):
        raise NotInformative("the propeller never turns in this test. Check the column n")
    if advance and np.ptp(test.V_A[turning] / test.n[turning]) == 0.0:
        raise NotInformative(
            "all runs have the same advance number, but K_T(J) needs several. Tow the thruster, or fit C_T to "
            "bollard pulls"
        )


def _doubts(test: OpenWaterTest, parameters: Mapping[str, Parameter]) -> tuple[Doubt, ...]:
    doubts = []
    if np.all(test.n >= 0.0) or np.all(test.n <= 0.0):
        doubts.append(Doubt("one-sided", "the propeller turned in only one direction", "measure astern too"))
    wrong = [n for n in ("alpha_1", "beta_1", "C_T", "C_n") if n in parameters and parameters[n].value <= 0.0]
    if wrong:
        doubts.append(
            Doubt("wrong-sign", f"{', '.join(wrong)} is not positive", "check the signs of n, thrust and torque")
        )
    return tuple(doubts)

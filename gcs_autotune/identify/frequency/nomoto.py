"""Fit Nomoto's models of first and second order to an empirical response, with standard errors.

Complex gains are fitted, not decibels and degrees, because the coherence gives their errors. The search runs over
``1/K`` and ``T/K`` (drag and inertia), which stay finite for a craft without drag.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.frequency.response import FrequencyResponse
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.models import Nomoto1, Nomoto2
from gcs_autotune.notebook import Display, Displayed, Table
from gcs_autotune.rounding import format_value

__all__ = ["EVIDENCE", "NomotoFit", "fit_nomoto"]

Array = NDArray[np.float64]

FLOOR = 0.003
"""Smallest standard deviation of a measured gain, relative to its magnitude. Project choice.

It covers the finite frequency resolution if the coherence shows no noise.
"""

LEAST, MOST = 1e-4, 3.0
"""Range of the model error, as a fraction of the motion. Project choice. At the upper end the model explains nothing.
"""

EVIDENCE = 10.0
"""Decrease of the Bayesian criterion at which a further parameter is accepted (Kass1995: very strong)."""


@dataclass(frozen=True, slots=True, eq=False)
class NomotoFit(Displayed):
    """A Nomoto model fitted to a frequency response.

    - ``model``: the fitted model of first or second order.
    - ``std``: standard errors by name (``K``, ``T`` or ``T_1 T_2 T_3``, ``delay``), 0 if not fitted.
    - ``physical``: ``1/K``, the other coefficients of the denominator over K, ``T_3``, and the delay.
    - ``covariance``: covariance of ``physical``.
    - ``misfit``: error of the model, which is the fraction of the motion that neither model nor noise explains.
    - ``bic``: Bayesian information criterion, comparable between models of the same response.
    """

    model: Nomoto1 | Nomoto2
    std: Mapping[str, float]
    physical: Array
    covariance: Array
    misfit: float
    bic: float

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as data for JSON."""
        return {"model": self.model.to_dict(), "std": dict(self.std), "misfit": self.misfit, "bic": self.bic}

    def _display(self) -> Display:
        order = "first" if isinstance(self.model, Nomoto1) else "second"
        rows = [
            (name, format_value(getattr(self.model, name), std), "velocity per input" if name == "K" else "s")
            for name, std in self.std.items()
        ]
        title = f"Nomoto model of {order} order; {self.misfit:.1%} of the motion is not explained"
        return Display(title, (Table(("parameter", "value ± standard error", "unit"), tuple(rows)),))


def fit_nomoto(response: FrequencyResponse, order: int = 1, delay: float | None = None) -> NomotoFit:
    """Return Nomoto's model of *order* 1 or 2, fitted to *response*.

    Points are weighted by their noise and by a model error. The model error is raised until it explains the residual.
    Without it, an approximate model would follow the point with the least noise.

    Parameters
    ----------
    delay : known delay [s]; None fits one and keeps it only on strong evidence. A delay is also kept if the time
        constant fitted without it is negative, so that the motion would precede the input.

    Raises
    ------
    NotInformative
        There are fewer points than parameters. The error is also raised if the second-order poles are complex, or
        unstable with a stable gain. A Nomoto model excludes such poles.
    """
    if delay is not None:
        return _fit(response, order, delay, free=False)
    try:
        without = _fit(response, order, 0.0, free=False)
    except NotInformative as error:
        if 2 * len(response) < _size(order):
            raise
        fit = _with_delay(response, order)
        if fit is None:
            raise error
        return fit
    if 2 * len(response) <= _size(order):
        return without
    fit = _with_delay(response, order)
    if fit is None:
        return without
    early = order == 1 and without.physical[1] * without.physical[0] < 0.0 < fit.physical[1] * fit.physical[0]
    return fit if without.bic - fit.bic > (0.0 if early else EVIDENCE) else without


def _with_delay(response: FrequencyResponse, order: int) -> NomotoFit | None:
    """Return the best fit with a positive delay, or None without one."""
    tries = []
    for phase in (0.1, 0.5, 1.5):
        try:
            tries.append(_fit(response, order, phase / float(response.omega.max()), free=True))
        except NotInformative:
            continue
    later = [fit for fit in tries if fit.physical[-1] > 0.0]
    return min(later, key=lambda fit: fit.bic) if later else None


def _fit(response: FrequencyResponse, order: int, delay: float, *, free: bool) -> NomotoFit:
    """Return the fit with the model error at which chi-squared has its expected value."""

    def at(error: float, start: Array | None = None) -> tuple[Array, float]:
        theta = _search(response, order, delay, error, start, free=free)
        spare = max(2 * len(response) - _size(order) + (0 if free else 1), 1)
        return theta, _cost(theta, response, error) / spare

    error = 0.0
    theta, chi = at(error)
    if chi > 1.0:
        low, high = LEAST, MOST
        for _ in range(BISECTIONS):
            error = math.sqrt(low * high)
            theta, chi = at(error, theta)
            low, high = (error, high) if chi > 1.0 else (low, error)
    fit = _described(response, order, theta, error, free=free)
    if isinstance(fit.model, Nomoto2):
        _check_reach(fit.model, float(response.omega.min()))
    return fit


def _check_reach(model: Nomoto2, lowest: float) -> None:
    if max(abs(model.T_1), abs(model.T_3)) * lowest > REACH:
        raise NotInformative(
            "the time constants of the second-order model correspond to frequencies below the lowest measured one, "
            f"{lowest:.2g} rad/s. Use the first-order model, or record slower motion"
        )


REACH = 30.0
"""Largest product of the longest time constant of the second-order model and the lowest measured frequency.

Beyond it the static gain is not determined. Project choice.
"""

BISECTIONS = 10
"""Number of bisections in the search for the logarithm of the model error.

They leave the model error uncertain by 1 %. Project choice.
"""


def _size(order: int) -> int:
    return {1: 3, 2: 5}[order]


def _sigma(response: FrequencyResponse, error: float) -> Array:
    """Return the standard deviation of the real and the imaginary part of each point.

    It combines noise, finite resolution and the model's relative *error*. Motion that the model misses is spread over
    its whole spectrum. It therefore contributes most where the input is weak.
    """
    power = np.maximum(response.input_power, np.finfo(float).tiny)
    typical = math.sqrt(float(np.sum(power * response.magnitude**2) / np.sum(power)))
    missed = error * typical / np.sqrt(power)
    sigma: Array = np.sqrt(response.std**2 + 0.5 * (FLOOR * response.magnitude) ** 2 + 0.5 * missed**2)
    return sigma


def _response(theta: Array, order: int, omega: Array) -> NDArray[np.complex128]:
    """Return the frequency response of a Nomoto model.

    theta : ``(1/K, a_1, [a_2, T_3], delay)`` of ``(1 + T_3 s) exp(-s delay) / (1/K + a_1 s + a_2 s^2)``.
    """
    s = 1j * omega
    denominator = theta[0] + theta[1] * s
    numerator = np.exp(-s * theta[-1])
    if order == 2:
        denominator = denominator + theta[2] * s * s
        numerator = numerator * (1.0 + theta[3] * s)
    value: NDArray[np.complex128] = numerator / denominator
    return value


def _residuals(theta: Array, response: FrequencyResponse, error: float) -> Array:
    order = 1 if len(theta) == 3 else 2
    miss = (_response(theta, order, response.omega) - response.value) / _sigma(response, error)
    return np.concatenate([miss.real, miss.imag])


def _cost(theta: Array, response: FrequencyResponse, error: float) -> float:
    return float(np.sum(_residuals(theta, response, error) ** 2))


def _search(
    response: FrequencyResponse, order: int, delay: float, error: float, start: Array | None = None, *, free: bool
) -> Array:
    """Return the parameters with the lowest cost, the delay last.

    free : whether the delay is fitted. The search starts at *start* or, without it, at *delay* and a linear solution.
    """
    wanted = _size(order) - (0 if free else 1)
    if 2 * len(response) < wanted:
        raise NotInformative(
            f"{len(response)} frequencies with coherence do not determine a Nomoto model of order {order}. Record "
            "longer, or use a wider sweep"
        )
    if start is None:
        start = np.append(_start(response, order, delay, error), delay)
    scale = np.maximum(np.abs(start), 1e-9 * np.max(np.abs(start)) + 1e-12)
    scale[-1] = max(delay, 0.1 / float(response.omega.max()))
    fitted = np.ones(len(start), dtype=bool)
    fitted[-1] = free

    def whole(x: Array) -> Array:
        theta = start.copy()
        theta[fitted] = x * scale[fitted]
        return theta

    def residuals(x: Array) -> Array:
        return _residuals(whole(x), response, error)

    def jacobian(x: Array) -> Array:
        table: Array = (_jacobian(whole(x), response, error) * scale)[:, fitted]
        return table

    optimum = least_squares(residuals, (start / scale)[fitted], jac=jacobian, method="lm")
    return whole(optimum.x)


def _start(response: FrequencyResponse, order: int, delay: float, error: float) -> Array:
    """Return the linear least-squares solution of ``G D(s) - N(s) + 1 = 1`` at this delay.

    The equations are reweighted by the denominator of the previous iteration.
    """
    s, weight = 1j * response.omega, 1.0 / _sigma(response, error)
    value = response.value * np.exp(s * delay)
    columns = [value, value * s] if order == 1 else [value, value * s, value * s * s, -s]
    rows, size = np.column_stack(columns), 1.0 / np.abs(value)
    theta = np.zeros(len(columns))
    for _ in range(8):
        table, wanted = rows * (weight * size)[:, None], weight * size + 0j
        real = np.concatenate([table.real, table.imag])
        norm = np.maximum(np.linalg.norm(real, axis=0), np.finfo(float).tiny)
        theta = np.linalg.lstsq(real / norm, np.concatenate([wanted.real, wanted.imag]), rcond=1e-12)[0] / norm
        denominator = theta[0] + theta[1] * s + (theta[2] * s * s if order == 2 else 0.0)
        size = 1.0 / np.maximum(np.abs(denominator), 1e-12 * np.max(np.abs(denominator)))
    return np.asarray(theta, dtype=np.float64)


def _described(response: FrequencyResponse, order: int, theta: Array, error: float, *, free: bool) -> NomotoFit:
    """Return the fit with parameters *theta*, their names and standard errors, and the evidence."""
    fitted = np.ones(len(theta), dtype=bool)
    fitted[-1] = free
    J = _jacobian(theta, response, error)[:, fitted]
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(fitted, fitted)] = inverse_of(J.T @ J)
    model, by_physical = _named(theta, order)
    names = ("K", "T", "delay") if order == 1 else ("K", "T_1", "T_2", "T_3", "delay")
    std = np.sqrt(np.maximum(np.diag(by_physical @ covariance @ by_physical.T), 0.0))
    parameters = int(fitted.sum()) + (1 if error > 0.0 else 0)
    spread = 4.0 * float(np.sum(np.log(_sigma(response, error))))
    bic = _cost(theta, response, error) + spread + parameters * math.log(2 * len(response))
    return NomotoFit(model, dict(zip(names, std.tolist(), strict=True)), theta, covariance, error, bic)


def _jacobian(theta: Array, response: FrequencyResponse, error: float) -> Array:
    """Return the analytic derivatives of the residuals by the parameters."""
    order, s = (1 if len(theta) == 3 else 2), 1j * response.omega
    value = _response(theta, order, response.omega)
    denominator = theta[0] + theta[1] * s + (theta[2] * s * s if order == 2 else 0.0)
    columns = [-value / denominator, -value * s / denominator]
    if order == 2:
        columns += [-value * s * s / denominator, value * s / (1.0 + theta[3] * s)]
    columns.append(-s * value)
    table = np.column_stack(columns) / _sigma(response, error)[:, None]
    return np.concatenate([table.real, table.imag])


def _named(theta: Array, order: int) -> tuple[Nomoto1 | Nomoto2, Array]:
    """Return the Nomoto model, and the derivatives of its parameters by *theta*."""
    K = 1.0 / theta[0] if theta[0] else math.inf
    G = np.zeros((len(theta), len(theta)))
    G[0, 0], G[-1, -1] = -(K**2), 1.0
    if order == 1:
        G[1, :2] = -theta[1] * K**2, K
        return Nomoto1(K, float(theta[1] * K), float(theta[2])), G
    total, product = theta[1] * K, theta[2] * K
    discriminant = total**2 - 4.0 * product
    if discriminant <= 0.0:
        raise NotInformative(
            "the poles of the second-order model are complex, which a Nomoto model excludes. Use the first-order "
            "model, or sweep to a higher frequency"
        )
    root = math.sqrt(discriminant)
    times = sorted((0.5 * (total + root), 0.5 * (total - root)), key=abs, reverse=True)
    if times[1] <= 0.0:
        raise NotInformative(
            "the fast pole of the second-order model is unstable, because it lies above the measured frequencies. "
            "Use the first-order model, or sweep to a higher frequency"
        )
    for row, T in enumerate(times, start=1):
        by_total, by_product = T / (2.0 * T - total), -1.0 / (2.0 * T - total)
        G[row, 0] = by_total * -theta[1] * K**2 + by_product * -theta[2] * K**2
        G[row, 1], G[row, 2] = by_total * K, by_product * K
    G[3, 3] = 1.0
    return Nomoto2(float(K), *(float(v) for v in (*times, theta[3], theta[4]))), G

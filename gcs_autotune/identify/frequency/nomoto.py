"""Nomoto's models of first and second order fitted to an empirical response, with standard errors.

Complex gains are fitted, not decibels and degrees: their errors are what the coherence tells. The search runs over
``1/K`` and ``T/K`` (inertia and drag), which stay finite for a craft that is all inertia.
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
from gcs_autotune.models.nomoto import Nomoto1, Nomoto2

__all__ = ["NomotoFit", "fit_nomoto"]

Array = NDArray[np.float64]

FLOOR = 0.003
"""Smallest relative error of a gain. Chosen: what finite resolution leaves where the coherence sees no noise at all."""

EVIDENCE = 10.0
"""Fall of the Bayesian criterion that makes a delay believed (Kass and Raftery 1995: very strong)."""


@dataclass(frozen=True, slots=True, eq=False)
class NomotoFit:
    """A Nomoto model fitted to a response.

    ``std`` standard errors by name (``K``, ``T`` or ``T_1 T_2 T_3``, ``delay``; 0: not fitted); ``physical`` and its
    ``covariance``: those of ``1/K``, of the denominator's further coefficients over K, of ``T_3``, of the delay;
    ``misfit`` root of chi-squared per degree of freedom (1: the model explains all but the noise); ``bic``.
    """

    model: Nomoto1 | Nomoto2
    std: Mapping[str, float]
    physical: Array
    covariance: Array
    misfit: float
    bic: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {"model": self.model.to_dict(), "std": dict(self.std), "misfit": self.misfit, "bic": self.bic}


def fit_nomoto(response: FrequencyResponse, order: int = 1, delay: float | None = None) -> NomotoFit:
    """Fit Nomoto's model of *order* 1 or 2 to *response*.

    Parameters
    ----------
    delay : known delay [s]; None fits one and keeps it on strong evidence only.

    Raises
    ------
    NotInformative
        Fewer points than parameters, or poles of second order that come out complex: no Nomoto model.
    """
    if delay is not None:
        return _fitted(response, order, _search(response, order, delay, free=False), free=False)
    without = _fitted(response, order, _search(response, order, 0.0, free=False), free=False)
    if len(response) * 2 <= _size(order):
        return without
    reach = float(response.omega.max())
    tries = [_search(response, order, phase / reach, free=True) for phase in (0.1, 0.5, 1.5)]
    best = min(tries, key=lambda found: _cost(found, response))
    with_one = _fitted(response, order, best, free=True)
    believed = best[-1] > 0.0 and without.bic - with_one.bic > EVIDENCE
    return with_one if believed else without


def _size(order: int) -> int:
    return {1: 3, 2: 5}[order]


def _weights(response: FrequencyResponse) -> Array:
    std: Array = np.hypot(response.std, FLOOR * response.magnitude / math.sqrt(2.0))
    return 1.0 / std


def _response(theta: Array, order: int, omega: Array) -> NDArray[np.complex128]:
    """Return G of ``(1/K, a_1, [a_2, T_3], delay)``: ``(1 + T_3 s) exp(-s delay) / (1/K + a_1 s + a_2 s^2)``."""
    s = 1j * omega
    denominator = theta[0] + theta[1] * s
    numerator = np.exp(-s * theta[-1])
    if order == 2:
        denominator = denominator + theta[2] * s * s
        numerator = numerator * (1.0 + theta[3] * s)
    value: NDArray[np.complex128] = numerator / denominator
    return value


def _residuals(theta: Array, response: FrequencyResponse) -> Array:
    error = (_response(theta, 1 if len(theta) == 3 else 2, response.omega) - response.value) * _weights(response)
    return np.concatenate([error.real, error.imag])


def _cost(theta: Array, response: FrequencyResponse) -> float:
    return float(np.sum(_residuals(theta, response) ** 2))


def _search(response: FrequencyResponse, order: int, delay: float, *, free: bool) -> Array:
    """Return the parameters of least cost, the delay last, searched from *delay* when it is *free*."""
    wanted = _size(order) - (0 if free else 1)
    if 2 * len(response) < wanted:
        raise NotInformative(
            f"{len(response)} frequencies with coherence do not determine a Nomoto model of order {order}: "
            "record longer, or with a wider sweep"
        )
    start = np.append(_start(response, order, delay), delay)
    scale = np.maximum(np.abs(start), 1e-9 * np.max(np.abs(start)) + 1e-12)
    scale[-1] = max(delay, 0.1 / float(response.omega.max()))
    fitted = np.ones(len(start), dtype=bool)
    fitted[-1] = free

    def cost(x: Array) -> Array:
        theta = start.copy()
        theta[fitted] = x * scale[fitted]
        return _residuals(theta, response)

    found = least_squares(cost, (start / scale)[fitted], method="lm" if 2 * len(response) >= wanted else "trf")
    theta = start.copy()
    theta[fitted] = found.x * scale[fitted]
    return theta


def _start(response: FrequencyResponse, order: int, delay: float) -> Array:
    """Return the linear least-squares solution of ``G D(s) - N(s) + 1 = 1``, reweighted by the denominator found."""
    s, weight = 1j * response.omega, _weights(response)
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


def _fitted(response: FrequencyResponse, order: int, theta: Array, *, free: bool) -> NomotoFit:
    fitted = np.ones(len(theta), dtype=bool)
    fitted[-1] = free
    J = _jacobian(theta, response)[:, fitted]
    norm = np.maximum(np.linalg.norm(J, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv((J / norm).T @ (J / norm), rcond=1e-13) / np.outer(norm, norm)
    cost, n = _cost(theta, response), 2 * len(response)
    misfit = math.sqrt(cost / max(n - int(fitted.sum()), 1))
    covariance = np.zeros((len(theta), len(theta)))
    covariance[np.ix_(fitted, fitted)] = inverse * max(1.0, misfit**2)
    model, by_physical = _named(theta, order)
    names = ("K", "T", "delay") if order == 1 else ("K", "T_1", "T_2", "T_3", "delay")
    std = np.sqrt(np.maximum(np.diag(by_physical @ covariance @ by_physical.T), 0.0))
    bic = cost + float(fitted.sum()) * math.log(n)
    return NomotoFit(model, dict(zip(names, std.tolist(), strict=True)), theta, covariance, misfit, bic)


def _jacobian(theta: Array, response: FrequencyResponse) -> Array:
    """Return the derivative of the residuals by the parameters, analytic."""
    order, s = (1 if len(theta) == 3 else 2), 1j * response.omega
    value = _response(theta, order, response.omega)
    denominator = theta[0] + theta[1] * s + (theta[2] * s * s if order == 2 else 0.0)
    columns = [-value / denominator, -value * s / denominator]
    if order == 2:
        columns += [-value * s * s / denominator, value * s / (1.0 + theta[3] * s)]
    columns.append(-s * value)
    table = np.column_stack(columns) * _weights(response)[:, None]
    return np.concatenate([table.real, table.imag])


def _named(theta: Array, order: int) -> tuple[Nomoto1 | Nomoto2, Array]:
    """Return the model and the Jacobian of its parameters by *theta*."""
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
            "the second order's poles come out complex: no Nomoto model; the first order serves, or a sweep that "
            "reaches higher"
        )
    root = math.sqrt(discriminant)
    times = sorted((0.5 * (total + root), 0.5 * (total - root)), key=abs, reverse=True)
    for row, T in enumerate(times, start=1):
        by_total, by_product = T / (2.0 * T - total), -1.0 / (2.0 * T - total)
        G[row, 0] = by_total * -theta[1] * K**2 + by_product * -theta[2] * K**2
        G[row, 1], G[row, 2] = by_total * K, by_product * K
    G[3, 3] = 1.0
    return Nomoto2(float(K), *(float(v) for v in (*times, theta[3], theta[4]))), G

"""jax-sysid: u, v, r in products of degree 2, stepped by Euler, its own L-BFGS on several runs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.methods import Predict
from benchmarks.real_runs.runs import FIRST, STEP, Run

__all__ = ["train"]


def train(runs: Sequence[Run], form: str) -> Predict:
    """Fit with signals scaled to unit deviation; terms: all products of degree 2, and those with one modulus."""
    import jax
    import jax.numpy as jnp
    from jax_sysid.models import Model

    jax.config.update("jax_enable_x64", True)
    m = runs[0].U.shape[1]
    scale_u, scale_y = np.vstack([r.U for r in runs]).std(axis=0), np.vstack([r.Y for r in runs]).std(axis=0)

    @jax.jit
    def library(x: jax.Array, u: jax.Array) -> jax.Array:
        products = [x[i] * x[j] for i in range(3) for j in range(i, 3)]
        moduli = [jnp.abs(x[i]) * x[j] for i in range(3) for j in range(3)]
        return jnp.concatenate([x, u, jnp.ones(1), jnp.array(products + moduli)])

    size = 3 + m + 1 + 6 + 9

    @jax.jit
    def state(x: jax.Array, u: jax.Array, params: list[jax.Array]) -> jax.Array:
        return jnp.clip(x + STEP * params[0] @ library(x, u), -20.0, 20.0)

    @jax.jit
    def output(x: jax.Array, u: jax.Array, params: list[jax.Array]) -> jax.Array:
        return x

    model = Model(3, 3, m, state_fcn=state, output_fcn=output)
    first = np.zeros((3, size))
    first[:, :3] = -0.3 * np.eye(3)
    model.init(params=[first])
    model.loss(rho_x0=1e-4, rho_th=1e-4)
    model.optimization(adam_epochs=200, lbfgs_epochs=500, iprint=-1)
    model.fit([r.Y / scale_y for r in runs], [r.U / scale_u for r in runs])

    def predict(run: Run) -> tuple[NDArray[np.float64], None]:
        U, Y = run.U / scale_u, (run.Y / scale_y).copy()
        x = jnp.asarray(Y[FIRST - 1])
        for i in range(FIRST, len(Y)):
            x = state(x, U[i - 1], model.params)
            Y[i] = np.asarray(x)
        return Y * scale_y, None

    return predict

"""The cluster by bayeschute's public door: its study of the drop, the look-alike predicted."""

from pathlib import Path

import exchange
import numpy as np

import bayeschute as bc

problem = exchange.read()
study = bc.Study.load(Path(__file__).parents[2] / "models/studies/cdt-3-11.toml")
posterior = bc.sample(bc.fit(study))
forecast = posterior.predict(study.flights["cdt-3-12"])

motion = {name: forecast.draws[name].values[:, ::2] for name in ("swing_angle", "descent_rate")}
exchange.write(problem, ("jax", "numpy"), [], np.zeros((0, 0, 0)), motion, {})

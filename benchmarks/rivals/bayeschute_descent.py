"""Descent of a point mass by bayeschute's public door: latent vertical air, fast and slow."""

import exchange
import numpy as np

import bayeschute as bc

problem = exchange.read()
columns = {"time": ("time", "s"), "altitude": ("altitude", "m"), "descent_rate": ("descent_rate", "m/s")}
record = bc.read_record(problem.folder / "whole.csv", columns)
flight = bc.Flight(record, name="sonde", identify_until=f"{problem.record['time'][-1]} s")
((name, (centre, width)),) = problem.priors.items()
drag = bc.Prior("cds_over_mass", centre, width, logarithmic=True, unit="m^2/kg", source="data sheet")
noise = bc.noise(
    {
        "descent_rate": {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"},
        "wind": {"vertical": "0.5 m/s", "time_constant": "10 s"},
        "slow_wind": {"vertical": "0.3 m/s", "time_constant": "100 s"},
    }
)
posterior = bc.sample(bc.fit(flight, bc.Priors.of(drag), noise=noise))
forecast = posterior.predict(flight)

chains = np.log(posterior.data["posterior"]["cds_over_mass"].values)[:, :, None]
motion = forecast.draws["descent_rate"].values[:, forecast.held_out]
exchange.write(problem, ("jax", "numpy"), [name], chains, {"descent_rate": motion}, {})

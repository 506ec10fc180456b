"""Descent of a point mass by RocketPy's MonteCarlo: predicted with the prior's uncertainty, nothing identified."""

import exchange
import numpy as np
import rocketpy
from rocketpy import MonteCarlo, StochasticEnvironment, StochasticFlight, StochasticRocket
from rocketpy.stochastic import StochasticParachute

problem = exchange.read()
((name, (centre, width)),) = problem.priors.items()
mass, (altitude, speed) = 1.0, problem.next_start
air = rocketpy.Environment(latitude=45.5, longitude=0.0, elevation=0.0)
air.set_atmospheric_model("standard_atmosphere")
rocket = rocketpy.Rocket(0.05, mass, (0.01, 0.01, 0.01), 0.5, 0.5, 0.0)
rocket.add_motor(rocketpy.EmptyMotor(), 0.0)
drag = np.exp(centre + width * np.random.default_rng(problem.seed).standard_normal(60)) * mass
chute = rocketpy.Parachute("main", float(np.exp(centre)) * mass, lambda p, h, y: True, 100)
stochastic = StochasticRocket(rocket)
stochastic.add_parachute(StochasticParachute(chute, cd_s=list(drag)))
start = [0.0, 0.0, 0.0, altitude, 0.0, 0.0, -speed, 1.0, *(0.0,) * 6]
flight = rocketpy.Flight(rocket, air, rail_length=1.0, initial_solution=start, max_time=45.0, terminate_on_apogee=False)
times = problem.next["time"] - problem.next["time"][0]


def rates(one):
    rows = np.array([[row[0], row[6]] for row in one.solution])
    return (-np.interp(times, rows[:, 0], rows[:, 1])).tolist()


campaign = MonteCarlo(
    str(problem.folder / "rocketpy"), StochasticEnvironment(air), stochastic,
    StochasticFlight(flight, initial_solution=start),
    export_list=["t_final"],  # its usual list asks for the rail and the motor
    data_collector={"rates": rates},
)  # fmt: skip
campaign.simulate(60, append=False)
motion = {"descent_rate": np.array(campaign.results["rates"])}
exchange.write(
    problem, ("rocketpy", "numpy"), [name], np.zeros((0, 0, 1)), motion, {}, "60 flights with the prior's drag area"
)

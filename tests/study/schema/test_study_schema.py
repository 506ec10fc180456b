"""Every table refuses what it can't use, and says where, what it got, what it wanted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from bayeschute.study.load import check_study


def only_fault(path: Path) -> str:
    faults = check_study(path)
    assert len(faults) == 1, "\n".join(map(str, faults))
    return str(faults[0])


CLUSTER = [
    (r'^swing = "17 deg"', "swing = 17", "[flight.virtual] swing (flight 'cdt-3-11')", "bare number", "'17 deg'"),
    (r'^swing = "17 deg"', 'swing = "17 ft"', "swing", "'17 ft'", "rad"),
    (r'^swing = "17 deg"', 'swing = "0.3"', "swing", "'0.3'", "rad"),
    (r'^swing = "17 deg"', "swing = nan", "swing", "bare number", "rad"),
    (r'^swing = "17 deg"', 'swing = "120 deg"', "swing", "'120 deg'", "<= 1.4 rad"),
    (r'^swing = "17 deg"', "swing = []", "swing", "[]", "rad"),
    (r'^swing = "17 deg"', "swin = 1\nswing = '17 deg'", "[flight.virtual] swin", "unknown key 'swin'", "mean 'swing'"),
    (r'^swing = "17 deg"', "", "[flight.virtual] swing", "nothing", "required"),
    (r'^duration = "90 s"', 'duration = "-90 s"', "duration", "'-90 s'", "> 0 s"),
    (r'^duration = "90 s"', 'duration = "3 s"', "[flight] virtual (flight 'cdt-3-11')", "30 samples", "50 to"),
    (r'^rate = "10 Hz"', 'rate = "10 deg/s"', "rate", "'10 deg/s'", "Hz"),
    (r'^altitude = \["0 ft", "2000 ft"', 'altitude = ["0 ft", "-1 ft"', "[flight.virtual] wind", "don't increase", "increase"),
    (r'^north = \["5 ft/s", ', "north = [", "[flight.virtual] wind", "4, 3 and 4 values", "as many winds"),
    (r'^horizontal = "2 ft/s"', 'horizontal = "-2 ft/s"', "[flight.virtual.turbulence]", "'-2 ft/s'", ">= 0 m/s"),
    (r"^amplitude = 0.02", 'amplitude = "0.03"', "breathing] amplitude", "'0.03'", "a number"),
    (r"^amplitude = 0.02", "amplitude = true", "breathing] amplitude", "True", "a number"),
    (r"^amplitude = 0.02", "amplitude = nan", "breathing] amplitude", "nan", "a number"),
    (r'^wind = \{ correlated = "1 ft/s", .*', 'wind = { correlated = "1 ft/s" }', "sensors] wind", "no time_", "time_constant"),
    (r"share = 0.02", "share = 1.0", "sensors.dropouts] share", "1.0", "<= 0.95"),
    (r'^roles = \["structure", "identify"\]', 'roles = ["identfy"]', "roles, item 1", "'identfy'", "'identify'"),
    (r'^roles = \["structure", "identify"\]', 'roles = ["identify", "identify"]', "roles", "more than once", "once"),
    (r'^roles = \["structure", "identify"\]', 'roles = "identify"', "roles", "'identify'", "a list"),
    (r'^name = "cdt-3-11"', 'name = "../x"', "[flight] name", "'../x'", "a name of letters"),
    (r'^name = "cdt-3-11"', 'name = "CDT-3-12"', "[flight] name", "'cdt-3-12'", "once only"),
    (r"^canopies = \[1\]", "canopies = [3]", "[structure] canopies, item 1", "canopy 3", "1 to 2"),
    (r'^axial = \["1", ', 'axial = ["alfa", ', "[structure] axial", "'alfa'", "terms of the axial"),
    (r'^axial = \["1", ', 'axial = ["e", ', "[structure] axial", "vector", "terms of the axial"),
    (r'^transverse = \[\s+"e", ', 'transverse = ["q", ', "[structure] transverse", "0 vector factors", "transverse"),
    (r'^sigma_max = "1 sigma\^2"', 'sigma_max = "25"', "sigma_max", "'25'", "'25 sigma^2'"),
    (r"^inflation = 10.0", "inflation = -1", "[priors] inflation", "-1", ">= 1"),
    (r'mean = "234 ft", sd = "1 ft"', 'mean = "234 ft", sd = "-1 ft"', "[priors.given.riser_length] sd", "'-1 ft'", "> 0 m"),
    (r'mean = "234 ft", sd = "1 ft"', 'mean = "234 ft"', "[priors.given] riser_length", "mean", "mean and sd, or"),
    (r"log_sd = 0.2", "log_sd = -0.2", "[priors.given.riser_stiffness] log_sd", "-0.2", "> 0"),
    (r'^(?=riser_length = \{)', "canopy_pitch_damping = { mean = -0.1, sd = 0.0 }\n", "[priors.given] canopy_pitch_damping", "0", "a positive sd"),  # fmt: skip
    (r'^\[noise.wind\]', '[noise.wind]\nhorizntal = "1 m/s"', "[noise.wind] horizntal", "unknown", "mean 'horizontal'"),
    (r'^\[noise.wind\]', '[noise.wind]\nknots = "1 s"', "[noise.wind] knots", "unknown", "horizontal, vertical, time_constant"),
    (r'^horizontal = "1 ft/s"$', "", "[noise.slow_wind] horizontal", "nothing", "a speed"),
    (r'^frequency = "0.25 Hz"', "frequency = 0.25", "[noise.breathing] frequency", "bare number", "Hz"),
    (r'^frequency = "0.25 Hz"', 'frequency = "0 Hz"', "[noise.breathing] frequency", "'0 Hz'", "> 0 Hz"),
    (r"^damping_ratio = 0.1$", "damping_ratio = 1.5", "[noise.breathing] damping_ratio", "1.5", "<= 0.9"),
    (r"^damping_ratio = 0.1$", "", "[noise.breathing] damping_ratio", "nothing", "required"),
    (r"^(?=\[noise.breathing\])", '[noise.canopy_force]\nsd = 0\ntime_constant = "1 s"\n', "[noise.canopy_force] sd", "0", "> 0"),
    (r'^(?=capsule_attitude = \{ white = "0.1 deg", correlated = "0.2 deg", time_constant = "2 s")', 'tension = { white = "1 N", kind = "white" }\n', '[noise] tension', "unknown key 'tension'", 'riser_tension'),  # fmt: skip
    (r'^(?=capsule_attitude = \{ white = "0.1 deg", correlated = "0.2 deg", time_constant = "2 s")', 'riser_tension = { white = "1 m", kind = "white" }\n', '[noise.riser_tension] white', "'1 m'", 'N'),  # fmt: skip
    (r'^(?=capsule_attitude = \{ white = "0.1 deg", correlated = "0.2 deg", time_constant = "2 s")', 'swing_angle = { white = "1 m", kind = "white" }\n', '[noise.swing_angle] white', "'1 m'", 'rad'),  # fmt: skip
    (r'^(?=capsule_attitude = \{ white = "0.1 deg", correlated = "0.2 deg", time_constant = "2 s")', 'descent_rate = { white = "-1 ft/s", kind = "white" }\n', '[noise.descent_rate] white', "'-1 ft/s'", '> 0 m/s'),  # fmt: skip
    (r'^(?=riser_length = \{)', 'capsule_mass = { mean = "-9000 kg", sd = "90 kg" }\n', '[priors.given.capsule_mass] mean', "'-9000 kg'", '> 0 kg'),  # fmt: skip
    (r'^(?=riser_length = \{)', 'canopy_mass = { mean = "149 lbf", sd = "9 kg" }\n', '[priors.given.canopy_mass] mean', "'149 lbf'", 'kg'),  # fmt: skip
    (r'^(?=riser_length = \{)', 'capsule_mass = { mean = "9000 kg", sd = "2700 kg" }\n', '[priors.given] capsule_mass', '30%', 'at most 20% of the mass'),  # fmt: skip
    (r'^(?=riser_length = \{)', 'canopy_mass = { median = "149 kg", log_sd = 0.3 }\n', '[priors.given] canopy_mass', '30%', 'at most 20% of the mass'),  # fmt: skip
    (r'^(?=riser_length = \{)', 'capsule_inertia_factor_y = { mean = 1.0, sd = 0.5 }\n', '[priors.given] capsule_inertia_factor_y', '50%', 'at most 20% of the mean'),  # fmt: skip
    (r"^warmup = 300", "warmup = 3", "[sampler] warmup", "3", "from 50"),
    (r"^chains = 4", "chains = 1", "[sampler] chains", "1", "from 2"),
    (r"^draws = 500", "draws = 5e2", "[sampler] draws", "500.0", "a whole number"),
    (r"^draws = 500", "draws = 500\nstarts = 1", "[sampler] starts", "1", "from 2"),
    (r"^draws = 500", "draws = 500\nstarts = true", "[sampler] starts", "True", "whole number"),
    (r'^kind = "nuts"', 'kind = "hmc"', "[sampler] kind", "'hmc'", "'emcee'"),
    (r'^quantities = \["swing_angle", ', 'quantities = ["swing", ', "quantities, item 1", "'swing'", "swing_angle"),
    (r'^at_most = "33 ft/s"', 'at_most = "33 deg"', "[requirement] at_most (requirement 'mean", "'33 deg'", "m/s"),
    (r'^at_most = "33 ft/s"', "", "[requirement] (requirement 'mean", "neither", "exactly one"),
    (r'^statistic = "mean"', 'statistic = "last"', "[requirement] statistic", "'last'", "'maximum'"),
    (r"^seed = 1", "seed = -1", "seed", "-1", "whole number"),
    (r"^seed = 1", "seed = 0x" + "f" * 5000, "seed", "thousands of digits", "whole number"),
    (r'^vehicle = .*', "", "vehicle", "nothing", "vehicle file"),
    (r'^vehicle = .*', 'vehicle = "lost.toml"', "lost.toml", "no such file", "a TOML file"),
    (r'^model = "cluster"', 'model = "clutter"', "model", "'clutter'", "'cluster'"),
    (r'^title = .*', 'title = ""', "title", "''", "a short text"),
    (r"^seed = 1", "seed = 1\nsead = 2", "sead", "unknown key 'sead'", "mean 'seed'"),
]  # fmt: skip


@pytest.mark.parametrize(("pattern", "new", "where", "got", "wanted"), CLUSTER)
def test_cluster_study(cluster: Path, spoil, pattern: str, new: str, where: str, got: str, wanted: str):
    told = only_fault(spoil(cluster, pattern, new))
    assert where in told.split(": got")[0]
    assert got in told
    assert wanted in told


VEHICLE = [
    (r'^mass = "648.44 slug"', 'mass = "-1 kg"', "[capsule] mass", "'-1 kg'", "> 0 kg"),
    (r'^mass = "648.44 slug"', 'mass = "648.44 lbf"', "[capsule] mass", "'648.44 lbf'", "kg"),
    (r'^inertia = \["25000 kg m\^2", ', "inertia = [", "[capsule] inertia", "nothing", "required"),
    (r"^number = 2", "number = 2.0", "[canopies] number", "2.0", "a whole number"),
    (r'^rate = "riser"', 'rate = "line"', "[aero] rate", "'line'", "'airflow'"),
    (r'^"alpha\^2" = -0.870', '"beta^2" = -0.87', "[aero] axial", "beta^2", "alpha^2"),
    (r'^"e" = -0.095', '"e" = inf', "[aero.transverse] e", "inf", "a number"),
    (r'^damping = "10000 lbf s/ft"', 'damping = "10000 lbf/ft"', "[risers] damping", "lbf/ft", "N s/m"),
    (r"^\[risers\]", "[[risers]]", "risers", "[{", "a table"),
]


@pytest.mark.parametrize(("pattern", "new", "where", "got", "wanted"), VEHICLE)
def test_vehicle(cluster: Path, spoil, pattern: str, new: str, where: str, got: str, wanted: str):
    vehicle = spoil(cluster.parent / "vehicle.toml", pattern, new)
    told = only_fault(cluster)
    assert told.startswith(f"{vehicle} {where}")
    assert got in told
    assert wanted in told


DESCENT = [
    (r"^seed = 1", 'seed = 1\nvehicle = "v.toml"', "vehicle", "no use for", "Remove"),
    (r'^unit = "m"|"altitude_m", unit = "m"', '"altitude_m", unit = "kg"', "[columns.altitude] unit", "'kg'", "to m"),
    (r"^altitude = ", "altitud = ", "[columns.altitud]", "unknown variable", "mean 'altitude'"),
    (r'^identify_until = "65 %"', 'identify_until = "165 %"', "identify_until", "'165 %'", "between 0 and 100 %"),
    (r'^identify_until = "65 %"', "identify_until = 0.65", "identify_until", "0.65", "'65 %'"),
    (r'^identify_until = "65 %"', 'identify_until = "900 s"', "identify_until (flight 'my-d", "900 s", "and 199 s"),
    (r"^skip_first", "remove_velocity_bias = true\nskip_first", "remove_velocity_bias", "no use for", "Remove"),
    (r'^skip_first = "10 s"', 'skip_first = "500 s"', "skip_first", "500 s", "less than the 199 s"),
    (r'^skip_first = "10 s"', 'skip_first = "-1 s"', "skip_first", "'-1 s'", ">= 0 s"),
    (r"^skip_first", 'window = ["80 s", "10 s"]\nskip_first', "[flight] (flight 'my-", "80 s to 10 s", "before its end"),
    (r"^skip_first", 'window = ["10 s"]\nskip_first', "window", "nothing", "required"),
    (r"^skip_first", 'capsule_mass = "1 kg"\nskip_first', "capsule_mass", "no use for", "Remove"),
    (r'^roles = \["identify", "predict"\]', 'roles = ["predict"]', "[flight]", "no flight with the role", "one at least"),
    (r"^cds_over_mass = .*", "", "[priors.given] cds_over_mass", "nothing", "median and log_sd"),
    (r"^(?=cds_over_mass = )", "canopy_pitch_damping = { mean = -0.1, sd = 0.1 }\n", "[priors.given] canopy_pitch_damping", "no use", "Remove"),
    (r"^(?=cds_over_mass = )", "canopy_position_scale = { mean = 1.0, sd = 0.01 }\n", "[priors.given] canopy_position_scale", "no use", "Remove"),
    (r"^(?=cds_over_mass = )", 'wind_bias = { sd = "1 m/s" }\n', "[priors.given] wind_bias", "no use", "Remove"),
    (r"^(?=cds_over_mass = )", "enclosed_air_factor = { median = 1.0, log_sd = 0.1 }\n", "[priors.given] enclosed_air_factor", "no use", "Remove"),
    (r'^vertical = "0.5 m/s"', 'vertical = "0.5 m/s"\nhorizontal = "1 m/s"', "[noise.wind] horizontal", "no use", "Remove"),
    (r"^\[sampler\]", '[noise.breathing]\nsd = 0.1\nfrequency = "1 Hz"\ndamping_ratio = 0.1\n[sampler]', "[noise] breathing", "no use", "Remove"),
    (r"^\[sampler\]", '[noise.slow_wind]\nhorizontal = "1 m/s"\nvertical = "1 m/s"\ntime_constant = "1 min"\n[sampler]', "[noise.slow_wind] horizontal", "no use", "Remove"),
    (r"^\[sampler\]", '[noise.canopy_force]\nsd = 0.1\ntime_constant = "1 s"\n[sampler]', "[noise] canopy_force", "no use", "Remove"),
    (r"^\[sampler\]", '[noise.roll]\nsd = 0.1\ntime_constant = "1 s"\n[sampler]', "[noise] roll", "no use", "Remove"),
    (r'white = "0.4 m/s", ', "", "[noise] descent_rate", "correlated, time_constant", "white"),
    (r'^quantities = \["descent_rate", ', 'quantities = ["swing_angle", ', "[predict] quantities, item 1", "swing", "descent"),
    (r'^file = .*', "", "[flight] (flight 'my-descent')", "neither", "either a file or"),
    (r'^file = .*', 'file = "lost.csv"', "[flight] file", "no such file", "a record"),
    (r'^file = .*', 'file = "${DATA}/x.csv"', "[flight] file", "no data folder", "--data DIR"),
]  # fmt: skip


@pytest.mark.parametrize(("pattern", "new", "where", "got", "wanted"), DESCENT)
def test_descent_study(
    descent: Path, spoil, monkeypatch: pytest.MonkeyPatch, pattern: str, new: str, where: str, got: str, wanted: str
):
    monkeypatch.delenv("BAYESCHUTE_DATA", raising=False)
    spoil(descent, pattern, new)
    told = "\n".join(map(str, check_study(descent)))
    first = told.splitlines()[0]
    assert where in first.split(": got")[0]
    assert got in first
    assert wanted in first


def test_the_wind_of_the_cluster_model_has_a_horizontal_part(cluster: Path, spoil):
    text = cluster.read_text(encoding="utf-8")
    head, tail = text.rsplit('horizontal = "2 ft/s"', 1)
    cluster.write_text(head + tail, encoding="utf-8")
    assert "[noise.wind] horizontal: got nothing" in only_fault(cluster)


def test_a_scale_of_positions_is_of_no_use_where_none_is_fitted(cluster: Path, spoil):
    spoil(cluster, r"^# canopy_position_scale", "canopy_position_scale")
    assert check_study(cluster) == []
    head, noise = cluster.read_text(encoding="utf-8").rsplit("canopy_position = ", 1)
    cluster.write_text(head + noise.split("\n", 1)[1], encoding="utf-8")
    told = only_fault(cluster)
    assert "[priors.given] canopy_position_scale" in told and "no use" in told and "Remove" in told


def test_constant_errors_have_a_positive_sd_and_are_of_no_use_where_their_channel_is_not_fitted(cluster: Path, spoil):
    spoil(cluster, r"^# canopy_position_scale", 'capsule_attitude_bias = { sd = "0.5 deg" }\n# canopy_position_scale')
    assert check_study(cluster) == []
    spoil(cluster, '^capsule_attitude_bias = { sd = "0.5 deg" }', 'capsule_attitude_bias = { sd = "-1 deg" }')
    assert "[priors.given.capsule_attitude_bias] sd" in only_fault(cluster)
    spoil(cluster, '^capsule_attitude_bias = { sd = "-1 deg" }', 'capsule_attitude_bias = { sd = "1 deg" }')
    head, noise = cluster.read_text(encoding="utf-8").rsplit("capsule_attitude = ", 1)
    cluster.write_text(head + noise.split("\n", 1)[1], encoding="utf-8")
    told = only_fault(cluster)
    assert "[priors.given] capsule_attitude_bias" in told and "no use" in told and "Remove" in told


def test_one_canopy_has_no_flyout_angle(cluster: Path, spoil):
    from bayeschute.study.schema.study_schema import predictable

    one, two = (SimpleNamespace(canopies=SimpleNamespace(number=number)) for number in (1, 2))
    every = predictable("cluster", two)
    assert "flyout_angle" in every and predictable("cluster", None) == every
    assert predictable("cluster", one) == tuple(name for name in every if name != "flyout_angle")
    assert predictable("cluster", one, ["flyout_angle", "swing_angle"]) == ("swing_angle",)
    assert predictable("descent", None) == ("descent_rate", "sea_level_descent_rate")
    spoil(cluster.parent / "vehicle.toml", r"^number = 2", "number = 1")
    spoil(cluster, r'^quantity = "sea_level_descent_rate"', 'quantity = "flyout_angle"')
    spoil(cluster, r'^at_most = "33 ft/s"', 'at_most = "15 deg"')
    told = [str(fault) for fault in check_study(cluster)]
    assert any("[requirement] quantity" in one and "'flyout_angle'" in one for one in told), told


def test_a_bad_quantity_of_a_requirement_hides_no_second_fault(cluster: Path, spoil):
    spoil(cluster, r'^quantity = "sea_level_descent_rate"', 'quantity = "speed"')
    assert "[requirement] quantity" in str(check_study(cluster)[0])


def test_an_airflow_rate_that_takes_all_inertia_or_enters_twice_is_refused() -> None:
    import tomllib
    from pathlib import Path

    from pydantic import ValidationError

    from bayeschute.study.schema.vehicle_schema import Vehicle

    text = (Path(__file__).parents[3] / "models" / "vehicles" / "cpas-two-mains.toml").read_text()
    raw = tomllib.loads(text)
    raw["aero"]["rate"] = "airflow"
    with pytest.raises(ValidationError, match="apparent mass"):
        Vehicle.model_validate(raw)
    raw["aero"]["transverse"]["rate"] = -0.2
    Vehicle.model_validate(raw)
    raw["aero"]["transverse"]["rate*(e.rate)"] = 0.1
    with pytest.raises(ValidationError, match="rate once"):
        Vehicle.model_validate(raw)

# %% [markdown]
# # Parts on their own: a tyre, a suspension, a steering unit's model; wrong input

# %% A tyre: lateral force over slip angle at three loads.
import numpy as np

import kingpin

alpha_rad = np.linspace(-0.2, 0.2, 81)
loads_n = np.array([2000.0, 4000.0, 6000.0])
tyre = kingpin.evaluate_tyre("car_205_60r15", Fz_N=loads_n[:, None], alpha_rad=alpha_rad)
print("largest lateral force", tyre["Fy_N"].max(axis=1).round(), "N")
assert tyre["Fy_N"].shape == (3, 81) and (tyre["Fy_N"][:, 0] > 0).all()

# %% A suspension: toe over wheel travel, and the tie-rod forces under a lateral force at the wheels.
axle = kingpin.suspension("sedan_double_wishbone")
bump = axle.curve("travel", np.linspace(-0.05, 0.05, 21))
print(f"toe over {np.ptp(bump['at_m']):.2f} m of travel: {np.degrees(np.ptp(bump['toe_rad.left'])):.3f}°")
side_n = np.linspace(0.0, 3000.0, 7)
force = np.zeros((7, 2, 3))
force[:, :, 1] = side_n[:, None]
solved = axle.solve(rack_m=0.0, wheel_force_n=force)
assert (solved["status"] == 0).all()
print("rack force per lateral force:", np.polyfit(side_n, solved["rack_force_n"], 1)[0].round(4))

# %% A functional model, stepped with an input over time.
unit = kingpin.model("rack_eps")
print(unit.name, "inputs", unit.inputs)
name = next(iter(unit.inputs))
answer = unit.simulate({name: np.zeros(1000)}, step_s=1e-4)
assert all(np.isfinite(values).all() for values in answer.outputs.values()), answer.faults

# %% Wrong input: everything at once, each with its key and rule.
try:
    kingpin.run("slalom_120", {"car.body.sprung_mass_kg": -3, "speed.sped_km_h": 100})
except kingpin.ConfigError as error:
    for violation in error.violations:
        print(violation["key"], violation["value"], violation["rule"], violation["suggestion"])
    assert len(error.violations) >= 2
else:
    raise AssertionError("must be refused")

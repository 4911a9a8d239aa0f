# %% [markdown]
# # On-centre feel: the assist map's slope
# A weave of ISO 13674-1 (100 km/h, 0.2 Hz) with half, the shipped, and double the assist of the column EPS.
# Run it as a script, or cell by cell in an editor that knows `# %%`.

# %%
import os

import numpy as np

import kingpin

# Shorter for a quick look: KINGPIN_EXAMPLE_DURATION_S=6
duration_s = float(os.environ.get("KINGPIN_EXAMPLE_DURATION_S", "30"))
base = kingpin.run("weave_100", ["warm_up_s=0.1"], duration_s=0.2)
force_n = np.array(base.configuration["unit"]["assist"]["force_n"])

# %%
runs = {
    factor: kingpin.run(
        "weave_100",
        {"unit.assist.force_n": factor * force_n},
        duration_s=duration_s,
    )
    for factor in (0.5, 1.0, 2.0)
}
for factor, run in runs.items():
    torque = run["rig_measurement.steering_wheel_torque_n_m"]
    print(f"assist x {factor}: peak {np.nanmax(np.abs(torque.value)):.2f} {torque.unit}, {run.wall_s:.1f} s")

# %% More assist, less torque at the wheel.
peaks = [run.metrics["peaks"]["steering_wheel_torque_n_m"] for run in runs.values()]
assert peaks[0] > peaks[2], peaks

# %%
try:
    import matplotlib

    matplotlib.use(os.environ.get("MPLBACKEND", "Agg"))
    import matplotlib.pyplot as plt
except ImportError:
    plt = None
if plt is not None:
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for factor, run in runs.items():
        after = run["rig_measurement.steering_wheel_angle_rad"].time_s > min(10.0, 0.5 * duration_s)
        angle = np.degrees(run["rig_measurement.steering_wheel_angle_rad"].value[after])
        torque = run["rig_measurement.steering_wheel_torque_n_m"].value[after]
        acceleration = run["vehicle_state.acceleration_m_s2.y"].value[after]
        axes[0].plot(angle, torque, label=f"assist x {factor}")
        axes[1].plot(acceleration, torque, label=f"assist x {factor}")
    axes[0].set(xlabel="hand-wheel angle in °", ylabel="hand-wheel torque in N·m")
    axes[1].set(xlabel="lateral acceleration in m/s²", ylabel="hand-wheel torque in N·m")
    axes[1].legend()
    figure.savefig("weave.png", dpi=120)
    print("weave.png")

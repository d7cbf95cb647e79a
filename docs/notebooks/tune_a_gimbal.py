# %% [markdown]
# # Tune a gimbal
# From a rig and a log to a controller with known margins, judged on plants that the log leaves possible.

# %%
import gimbal_pin
from gimbal_pin.control import judge_controllers, pair_rivals, perturbed
from gimbal_pin.rig import make_generator

rig = gimbal_pin.Rig.load("thesis")
rig

# %% [markdown]
# What the motors do in half a minute of your own motion: `read_log("log.csv", rig)`. Here it is simulated, on bodies
# and friction that differ from the URDF's.

# %%
plant = perturbed(rig, 0.1, make_generator(1)[0])
log = gimbal_pin.bench_run(plant, rng=0, seconds=20.0)
gimbal_pin.animate(log, rig)

# %%
fit = gimbal_pin.identify(rig, log)
fit

# %% [markdown]
# The highest bandwidth that keeps a disk margin of 1, with a millisecond from measurement to torque.

# %%
tuning = gimbal_pin.tune(fit, disk_margin=1.0, delay=0.001)
tuning

# %% [markdown]
# Against a PID of the same disk margin: on plants that are off as the model may be, and in steps on the true one; both
# as late as the controller was tuned for, in seconds and in samples.

# %%
laws = pair_rivals(tuning.stored)
judge_controllers(fit.model, laws, rng=0, plants=10, delay=tuning.wish.delay)

# %%
gimbal_pin.track(plant, laws, rng=0, one_by_one=False, delay=tuning.wish.samples)

# %% [markdown]
# The same numbers as a table; `tuning.report("tuning.html")` writes the page.

# %%
tuning.to_frame().set_index("name")[
    ["kp", "ki", "kd", "bandwidth_hz", "disk_margin", "phase_margin_deg"]
]

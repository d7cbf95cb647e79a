# %% [markdown]
# # Find what the simulation gets wrong
# A motor that cogs, a log of it, the cause by its name, and what knowing it gains.

# %%
import gimbal_pin
from gimbal_pin.dynamics import plant_with
from gimbal_pin.effects import parse_effect

rig = gimbal_pin.Rig.load("turret")
motion = gimbal_pin.excite(rig, seconds=20.0, starts=1, rng=0)
motion

# %% [markdown]
# What this motion would show: from which size on each cause is found, and what it would be taken for before.

# %%
gimbal_pin.rehearse(rig, motion.motion, rng=0)

# %% [markdown]
# The real gimbal; here it is simulated, and its first motor has teeth that the URDF does not know.

# %%
plant = plant_with(
    gimbal_pin.nominal(rig), [parse_effect("cogging:pan:amplitude=0.03,harmonic=12", rig)]
).plant
log = gimbal_pin.bench_run(plant, rng=0, seconds=25.0)
log

# %%
found = gimbal_pin.diagnose(rig, log)
found

# %% [markdown]
# The extended model holds the cause; what is tuned for it compensates it.

# %%
found.after

# %%
found.errors

# %%
found.to_frame()[["cause", "joint", "status", "probability", "explained_share"]]

# %% [markdown]
# # Swap the camera
# The gimbal is known; a new camera is mounted. Ten seconds of motion tell where it sits, and the controller follows.

# %%
import gimbal_pin
from gimbal_pin.control import perturbed
from gimbal_pin.identification import identify_new
from gimbal_pin.rig import make_generator

first = gimbal_pin.Rig.load("turret", payload="infrared")
log = gimbal_pin.bench_run(gimbal_pin.nominal(first), rng=0, seconds=20.0)
known = gimbal_pin.identify(first, log)
known

# %% [markdown]
# The other camera, as its URDF states it, and what the motors do with it.

# %%
second = gimbal_pin.Rig.load("turret", payload="mirrorless")
second

# %%
plant = perturbed(second, 0.05, make_generator(2)[0])
short = gimbal_pin.bench_run(plant, rng=1, seconds=10.0)
short

# %% [markdown]
# Only the camera is estimated; the gimbal is corrected as far as it was uncertain.

# %%
swapped = identify_new(second, [short], known.model)
swapped

# %% [markdown]
# The gains before and after.

# %%
before, after = (gimbal_pin.tune(fit, disk_margin=1.0) for fit in (known, swapped.first))
after

# %%
before.to_frame().merge(after.to_frame(), on="name", suffixes=(" before", " after")).filter(
    regex="name|^k|bandwidth"
)

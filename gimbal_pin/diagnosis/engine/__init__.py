"""One model with coloured noise and a discrepancy, one likelihood, one search.

``y = X β + Σ_k Z_k(η_k) γ_k + δ(state) + n(t)``: rigid body and friction, causes, what no cause explains, noise.

- `whitening`: rows whitened by other gains, without another pass over the log.
- `discrepancy`: δ, and how much of a residual it predicts where it has seen nothing.
- `noise`: the spectrum of n, from what no function of the state predicts.
- `alignment`: when each joint's measured torque acts.
- `criterion`: by how much one model is better than another.
- `prediction`: what a model predicts of blocks that it has not seen.
- `support`: what a model must be beside likely.
- `selection`: which causes, forward and backward with a beam.
- `rivals`: which causes the log does not part from those.
- `explained`: all of it, for some logs.
"""

from gimbal_pin.diagnosis.engine.explained import Explained, explain

__all__ = ["Explained", "explain"]

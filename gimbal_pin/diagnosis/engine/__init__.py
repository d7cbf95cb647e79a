"""One model with coloured noise and a discrepancy, one likelihood, one search.

``y = X β + Σ_k Z_k(η_k) γ_k + δ(state) + n(t)``: rigid body and friction, causes, what no cause explains, noise.

- `discrepancy`: δ, and how much of a residual it predicts where it has seen nothing.
- `noise`: the spectrum of n, from what no function of the state predicts, and rows whitened by it.
- `alignment`: when each joint's measured torque acts.
- `criterion`: by how much one model is better than another, and what a model must be beside likely.
- `selection`: which causes, forward and backward with a beam, and their rivals.
- `explained`: all of it, for some logs.
"""

from gimbal_pin.diagnosis.engine.explained import Explained, explain, is_hidden_by_noise

__all__ = ["Explained", "explain", "is_hidden_by_noise"]

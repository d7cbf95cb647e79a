"""Rigid-body dynamics on a base that may move: regressor, base parameters, the model, and the simulated plant."""

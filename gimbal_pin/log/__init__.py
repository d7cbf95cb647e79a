"""What was measured or simulated: trajectories, the sensors behind them, and their files."""

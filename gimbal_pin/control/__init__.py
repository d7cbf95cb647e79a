"""Control laws, their tuning, and how well they track; an experiment on the bench under one of them."""

"""The blind set: a plant of its own (MuJoCo, finer steps, other functional forms) that hides an effect in a log.

It was written from the contract alone, by one who has not seen the library, and imports nothing of it. One way through:

    draw.sample → cases.hide → files.write (log, rig) and, kept elsewhere, the truth
    judge.judge: (truth, what was diagnosed) → table.score: every figure, with its bounds
                                             → reliability.measure: stated probabilities against the truth
"""

"""Speed and memory, each figure beside its requirement; run by scripts/bench."""

"""Speed, memory and excitation, each figure beside its requirement; run by scripts/bench."""

"""Studies of a camera that is held still on a platform that moves."""

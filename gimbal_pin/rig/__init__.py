"""A gimbal as data: URDF, YAML, payloads, and what may be wrong with them."""

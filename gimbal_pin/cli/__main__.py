"""``python -m gimbal_pin.cli VERB``."""

from gimbal_pin.cli import main

main()

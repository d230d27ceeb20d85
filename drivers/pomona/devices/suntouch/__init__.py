"""SUNTouch force/tactile fingers: 25 taxels a finger over a serial line at 500 Hz, calibrated to contact wrenches."""

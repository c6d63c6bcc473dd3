"""A display file of the paper's motor, one finger."""

DISPLAY = """
[display]
name = "one finger"
rate_hz = 4000
delay_samples = 1
[threshold]
curve = "bolanowski-1988"
[feedback]
structure = "paper"
[[channel]]
name = "index"
finger = "index"
sensor_gain_v_per_mm = 0.19898
travel_mm = 12.5
plant = { num = [2875.0], den = [1.0, 94.0, 290.0] }
"""

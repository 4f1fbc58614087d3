import Config

# Simulated buses in the place of the board's. What hangs on them is what the robot declares (`simulation do … end`).
config :ganglion, i2c: BB.Bus.Sim.I2C, gpio: BB.Bus.Sim.GPIO

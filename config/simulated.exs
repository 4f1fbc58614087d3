import Config

# Simulated buses. The robot declares their devices (`simulation do … end`).
config :ganglion, i2c: BB.Bus.Sim.I2C, gpio: BB.Bus.Sim.GPIO

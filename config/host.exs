import Config

# Reports of normal starts and stops are for boards that are debugged over a console.
config :logger, handle_sasl_reports: false

# Standard output belongs to what a command prints; logs go to standard error. (The first key is for Elixir 1.14, the second for newer ones.)
config :logger, :console, device: :standard_error
config :logger, :default_handler, config: [type: :standard_error]

# A release on the host runs the robot from its start, as a board does, on its simulated buses.
if config_env() == :prod, do: config(:ganglion, robot: Ganglion.Robot)

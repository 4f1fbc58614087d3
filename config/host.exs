import Config

# Without reports of normal starts and stops.
config :logger, handle_sasl_reports: false

# Logs go to standard error, because commands print on standard output. The first key is for
# Elixir 1.14, the second for newer versions.
config :logger, :console, device: :standard_error
config :logger, :default_handler, config: [type: :standard_error]

# A release on the host starts the robot, on its simulated buses.
if config_env() == :prod, do: config(:ganglion, robot: Ganglion.Robot)

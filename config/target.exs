import Config

Application.start(:nerves_bootstrap)

import_config "firmware.exs"

config :mdns_lite, hosts: [:hostname, "ganglion"]

# The application starts this robot at boot.
config :ganglion, robot: Ganglion.Robot

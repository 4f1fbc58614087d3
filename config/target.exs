import Config

Application.start(:nerves_bootstrap)

import_config "firmware.exs"

config :mdns_lite, hosts: [:hostname, "ganglion"]

# On a board the robot runs from boot.
config :ganglion, robot: Ganglion.Robot

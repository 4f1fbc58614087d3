import Config

Application.start(:nerves_bootstrap)

# The ring's topics live in a file system of their own: beyond its size, publishers get an error and nothing else on the board suffers.
config :nerves, :erlinit, mount: "tmpfs:/dev/shm:tmpfs:nodev,nosuid,noexec:mode=1770,size=64m"

config :nerves, :firmware,
  rootfs_overlay: "rootfs_overlay",
  provisioning: "firmware/provisioning.conf"

config :nerves_runtime, :kernel, use_system_registry: false

config :shoehorn, init: [:nerves_runtime, :nerves_pack]

config :logger, backends: [RingLogger]

# Nobody gets in before keys are given: put public keys here, one string a key.
config :nerves_ssh, authorized_keys: []

config :vintage_net,
  regulatory_domain: "00",
  config: [
    {"usb0", %{type: VintageNetDirect}},
    {"eth0", %{type: VintageNetEthernet, ipv4: %{method: :dhcp}}},
    {"wlan0", %{type: VintageNetWiFi}}
  ]

config :mdns_lite,
  hosts: [:hostname, "ganglion"],
  ttl: 120,
  services: [%{protocol: "ssh", transport: "tcp", port: 22}]

# On a board the robot runs from boot, on the real buses.
config :ganglion, i2c: Circuits.I2C, robot: Ganglion.Robot

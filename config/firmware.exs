import Config

# What every board with Ganglion shares, whoever's robot runs on it. Ganglion's own config/target.exs imports this file, and so does
# each project that `mix ganglion.new` writes. It is read in the project's folder: overlay, provisioning and keys are the project's.

# The ring's topics live in a file system of their own: beyond its size, publishers get an error and nothing else on the board suffers.
config :nerves, :erlinit,
  update_clock: true,
  mount: "tmpfs:/dev/shm:tmpfs:nodev,nosuid,noexec:mode=1770,size=64m"

config :nerves, :firmware,
  rootfs_overlay: "rootfs_overlay",
  provisioning: "firmware/provisioning.conf"

# Shoehorn starts applications as temporary: one that ends stays ended, but for this handler.
config :shoehorn,
  init: [:nerves_runtime, :nerves_pack],
  handler: BB.Firmware.Applications

config :logger, backends: [RingLogger]

# BB.Firmware.Guard validates, when the robot works. This one would as soon as the applications have started.
config :nerves_runtime, startup_guard_enabled: false

# Before anything in /data is used, what is damaged there is set aside. It cannot end the start.
config :nerves_runtime, init_module: BB.Firmware.Init

# An update comes in through the gate, and only with a signature that fits the board's key.
config :ssh_subsystem_fwup,
  precheck_callback: {BB.Firmware.Gate, :precheck, []},
  success_callback: {BB.Firmware.Gate, :written, []}

# Keys only. Nobody gets in before there is a public key in firmware/keys/ssh/. Those of the image count, and no others: what is added on a
# running board lies in memory (user_dir), so that a key that is gone from the next image is gone from the board.
# Who has a key has the console, and with it the board: commands (exec) add nothing to that, and scripts need them. SFTP would be one more way
# to write into the file system, which nothing here needs.
ssh_keys = Path.wildcard("firmware/keys/ssh/*.pub")

config :nerves_ssh,
  authorized_keys: Enum.map(ssh_keys, &String.trim(File.read!(&1))),
  subsystems: [],
  exec: :elixir,
  iex_opts: [dot_iex: "/etc/iex.exs"],
  system_dir: "/data/nerves_ssh",
  user_dir: "/run/nerves_ssh",
  daemon_option_overrides: [auth_methods: ~c"publickey"]

# Which Wi-Fi, and by what name, is the card's affair (firmware/provisioning.conf, BB.Firmware.Provisioning): one image is for many robots.
config :vintage_net,
  regulatory_domain: "00",
  config: [
    {"usb0", %{type: VintageNetDirect}},
    {"eth0", %{type: VintageNetEthernet, ipv4: %{method: :dhcp}}},
    {"wlan0", %{type: VintageNetWiFi}}
  ]

# A project's name goes beside that of the card: `hosts: [:hostname, "rover"]`.
config :mdns_lite,
  hosts: [:hostname],
  ttl: 120,
  services: [%{protocol: "ssh", transport: "tcp", port: 22}]

config :nerves_motd, extra_rows: {Ganglion.Console, :motd_rows, []}

# The buses of the board, and who watches over the robot, and by what. Each project names its robot.
config :ganglion,
  i2c: Circuits.I2C,
  board: {BB.Firmware.Board.Nerves, []},
  network: {BB.Firmware.Network.VintageNet, []}

# Options of the parts of the firmware; see their documentation.
config :ganglion, BB.Firmware.Guard, folder: "/data/guard", reach: :lan
config :ganglion, BB.Firmware.Gate, public_key: "/etc/ganglion/firmware.pub"
config :ganglion, BB.Firmware.Network, disarm_after_ms: nil

# The board's own buses, or simulated ones.
import_config "buses.exs"

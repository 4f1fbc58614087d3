import Config

# The configuration that all boards share. Ganglion's config/target.exs imports this file, and so
# does each project that `mix ganglion.new` generates. Paths are relative to the project that
# imports it.

# The ring's topics have a file system of their own. When it is full, publishers get an error and
# the rest of the board is not affected.
config :nerves, :erlinit,
  update_clock: true,
  mount: "tmpfs:/dev/shm:tmpfs:nodev,nosuid,noexec:mode=1770,size=64m"

config :nerves, :firmware,
  rootfs_overlay: "rootfs_overlay",
  provisioning: "firmware/provisioning.conf"

# Shoehorn starts applications as temporary. This handler restarts those that end.
config :shoehorn,
  init: [:nerves_runtime, :nerves_pack],
  handler: BB.Firmware.Applications

config :logger, backends: [RingLogger]

# This guard would validate the firmware as soon as the applications have started.
# BB.Firmware.Guard validates it when the robot works.
config :nerves_runtime, startup_guard_enabled: false

# It renames damaged files in /data before anything uses them, and cannot fail the boot.
config :nerves_runtime, init_module: BB.Firmware.Init

# The gate admits an update only with a signature that fits the board's key.
config :ssh_subsystem_fwup,
  precheck_callback: {BB.Firmware.Gate, :precheck, []},
  success_callback: {BB.Firmware.Gate, :written, []}

# Login needs a key in firmware/keys/ssh/ at build time. A key that is added on a running board is
# in memory (user_dir) and is lost at the next boot, so that the keys of the image are the only
# lasting ones. The console controls the whole board, so that commands (exec) open nothing more;
# scripts need them. SFTP is off, because nothing needs it.
ssh_keys = Path.wildcard("firmware/keys/ssh/*.pub")

config :nerves_ssh,
  authorized_keys: Enum.map(ssh_keys, &String.trim(File.read!(&1))),
  subsystems: [],
  exec: :elixir,
  iex_opts: [dot_iex: "/etc/iex.exs"],
  system_dir: "/data/nerves_ssh",
  user_dir: "/run/nerves_ssh",
  daemon_option_overrides: [auth_methods: ~c"publickey"]

# The card has the Wi-Fi and the name (firmware/provisioning.conf, BB.Firmware.Provisioning), so
# that one image serves many robots.
config :vintage_net,
  regulatory_domain: "00",
  config: [
    {"usb0", %{type: VintageNetDirect}},
    {"eth0", %{type: VintageNetEthernet, ipv4: %{method: :dhcp}}},
    {"wlan0", %{type: VintageNetWiFi}}
  ]

# A project adds its name to the name of the card: `hosts: [:hostname, "rover"]`.
config :mdns_lite,
  hosts: [:hostname],
  ttl: 120,
  services: [%{protocol: "ssh", transport: "tcp", port: 22}]

config :nerves_motd, extra_rows: {Ganglion.Console, :motd_rows, []}

# The adapters of the board. The configuration of each project sets its robot.
config :ganglion,
  i2c: Circuits.I2C,
  board: {BB.Firmware.Board.Nerves, []},
  network: {BB.Firmware.Network.VintageNet, []}

# The options are documented in these modules.
config :ganglion, BB.Firmware.Guard, folder: "/data/guard", reach: :lan
config :ganglion, BB.Firmware.Gate, public_key: "/etc/ganglion/firmware.pub"
config :ganglion, BB.Firmware.Network, disarm_after_ms: nil

# Real or simulated buses.
import_config "buses.exs"

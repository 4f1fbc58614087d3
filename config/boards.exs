# The supported boards: the version of the Nerves system nerves_system_<board>, and the Rust
# target. mix.exs and `mix ganglion.new` read this file.
[
  rpi3: [system: "~> 2.0", rust: "armv7-unknown-linux-gnueabihf"],
  rpi4: [system: "~> 2.1", rust: "aarch64-unknown-linux-gnu"],
  rpi5: [system: "~> 2.1", rust: "aarch64-unknown-linux-gnu"],
  bbb: [system: "~> 2.20", rust: "armv7-unknown-linux-gnueabihf"],
  x86_64: [system: "~> 1.34", rust: "x86_64-unknown-linux-musl"],
  qemu_aarch64: [system: "~> 0.4", rust: "aarch64-unknown-linux-gnu"]
]

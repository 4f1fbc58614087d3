import Config

# What a board's image senses on: its own buses ("real"), or those of simulated.exs ("simulated"), for a board without chips. The
# machine that QEMU plays has no buses at all.
default = if config_target() == :qemu_aarch64, do: "simulated", else: "real"

case System.get_env("GANGLION_BUSES", default) do
  "real" ->
    :ok

  "simulated" ->
    import_config "simulated.exs"

  other ->
    raise ArgumentError,
          "expected GANGLION_BUSES to be real or simulated, got: #{inspect(other)}; " <>
            "without it the image for #{config_target()} has #{default} buses"
end

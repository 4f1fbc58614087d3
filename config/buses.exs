import Config

# The buses of a board's image: its own ("real"), or those of simulated.exs ("simulated"), for a
# board without chips. QEMU's machine has no buses.
default = if config_target() == :qemu_aarch64, do: "simulated", else: "real"

case System.get_env("GANGLION_BUSES", default) do
  "real" ->
    :ok

  "simulated" ->
    import_config "simulated.exs"

  other ->
    raise ArgumentError,
          "expected GANGLION_BUSES to be real or simulated, got: #{inspect(other)}; " <>
            "the default for #{config_target()} is #{default}"
end

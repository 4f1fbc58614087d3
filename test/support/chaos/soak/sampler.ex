defmodule BB.Test.Chaos.Soak.Sampler do
  @moduledoc """
  Writes the resources of a VM to a file, once a second: a line of `key=number` each.

  It is loaded into other VMs, on the host and in a release, and therefore uses only OTP.
  """

  @period_ms 1_000

  @doc "Starts to write to the file that the environment names."
  def start do
    case :os.getenv(~c"GANGLION_SOAK_SAMPLES") do
      false -> :ok
      file -> :erlang.spawn(fn -> open(file) end)
    end
  end

  defp open(file) do
    {:ok, io} = :file.open(file, [:append, :raw])
    sample(io)
  end

  defp sample(io) do
    :ok = :file.write(io, line())

    receive do
    after
      @period_ms -> sample(io)
    end
  end

  defp line do
    for {key, value} <- figures(), into: <<>> do
      <<:erlang.atom_to_binary(key)::binary, ?=, :erlang.integer_to_binary(value)::binary, ?\s>>
    end <> "\n"
  end

  defp figures do
    [
      os_pid: :erlang.list_to_integer(:os.getpid()),
      memory: :erlang.memory(:total),
      ets_memory: :erlang.memory(:ets),
      ets_tables: :erlang.length(:ets.all()),
      atoms: :erlang.system_info(:atom_count),
      ports: :erlang.system_info(:port_count),
      processes: :erlang.system_info(:process_count)
    ]
  end
end

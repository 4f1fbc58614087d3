defmodule Ganglion.Demo.LogTail do
  @moduledoc """
  A `:logger` handler that sends each line to a process as `{:log, line}`.

  The demonstration uses it to show the latest lines below its screen.

      :ok = Ganglion.Demo.LogTail.attach(self())
      receive do: ({:log, line} -> line)
  """

  @doc "Replaces all handlers of the VM, so that log lines go to `pid` and not to the terminal."
  @spec attach(pid()) :: :ok
  def attach(pid) do
    Enum.each(:logger.get_handler_ids(), &:logger.remove_handler/1)
    :ok = :logger.add_handler(__MODULE__, __MODULE__, %{config: %{pid: pid}, level: :info})
  end

  @doc false
  # The screen shows normal starts and alarms already.
  def log(%{level: level, meta: %{error_logger: _}}, _config) when level in [:info, :notice],
    do: :ok

  def log(%{level: level, meta: %{domain: [:otp | _]}}, _config) when level in [:info, :notice],
    do: :ok

  def log(%{level: level, msg: message}, %{config: %{pid: pid}}) do
    send(pid, {:log, "[#{level}] #{text(message)}"})
  end

  defp text({:string, text}), do: one_line(text)
  defp text({:report, report}), do: report |> inspect(limit: 20) |> one_line()
  defp text({format, arguments}), do: format |> :io_lib.format(arguments) |> one_line()

  defp one_line(text), do: text |> IO.chardata_to_string() |> String.replace(~r/\s+/, " ")
end

defmodule BB.Sensor.NativeProcess.Guard do
  @moduledoc """
  The port of `process_guard`, under which a native process runs.

  `BB.Sensor.NativeProcess` opens the port and owns it. The port's process is the guard's watch,
  which starts the guard. The guard starts the program, passes its output on, and ends it, with
  everything it started, when the port closes.

  A frame to or from the guard is a letter and its data, as `native/process_guard` documents.
  `parse/1` reads the guard's frames.

      iex> BB.Sensor.NativeProcess.Guard.parse("lready")
      {:line, "ready"}
      iex> BB.Sensor.NativeProcess.Guard.parse("o12")
      {:left_out, "12"}
  """

  alias BB.Sensor.NativeProcess.Program

  @program "process_guard"

  # Lines that the guard may send ahead. Half of them are acknowledged together.
  @window 64

  @typedoc """
  A frame from the guard: a line that the program printed, the number of lines that were left out
  here, the program being ended because a signal has halted it for too long, or the end of all
  output.
  """
  @type frame :: {:line, binary()} | {:left_out, binary()} | :halted | :end_of_output

  @doc "Opens the port, which starts the guard and the program."
  @spec open([String.t()], [{String.t(), String.t()}]) :: port()
  def open(arguments, env) do
    Port.open({:spawn_executable, Program.shipped(@program)}, [
      :binary,
      :exit_status,
      :hide,
      packet: 2,
      arg0: "process_watch",
      args: arguments,
      env: for({key, value} <- env, do: {to_charlist(key), to_charlist(value)})
    ])
  end

  @doc "Returns the guard's arguments for a sensor's options, and the program's after them."
  @spec arguments(keyword(), [String.t()]) :: [String.t()]
  def arguments(opts, command) do
    halt = if opts[:halt_ms] == :infinity, do: [], else: ["--halt-ms", opts[:halt_ms]]

    ["--grace-ms", opts[:grace_ms], "--nice", opts[:nice]]
    |> Kernel.++(["--lines-per-second", opts[:log_rate], "--frames", @window])
    |> Kernel.++(halt ++ ["--"])
    |> Enum.map(&to_string/1)
    |> Kernel.++(command)
  end

  @doc "Parses a frame from the guard."
  @spec parse(binary()) :: frame()
  def parse(<<"l", line::binary>>), do: {:line, line}
  def parse(<<"o", count::binary>>), do: {:left_out, count}
  def parse("h"), do: :halted
  def parse("e"), do: :end_of_output

  @doc """
  Acknowledges frames with output, `unacknowledged` of them.

  Returns the number of frames that are still not acknowledged: they are acknowledged by halves of
  the window, so that the guard is seldom disturbed and seldom waits.
  """
  @spec acknowledge(port(), non_neg_integer()) :: non_neg_integer()
  def acknowledge(_port, unacknowledged) when unacknowledged < div(@window, 2), do: unacknowledged

  def acknowledge(port, unacknowledged) do
    if send_frame(port, <<"c", unacknowledged::16>>), do: 0, else: unacknowledged
  end

  @doc "Tells the guard to end the program. Returns `false` when the guard has exited."
  @spec stop(port()) :: boolean()
  def stop(port), do: send_frame(port, "s")

  @doc """
  Confirms the end of all output.

  The guard may exit at any time from then on, and another frame to it would break the pipe.
  """
  @spec confirm_end(port()) :: boolean()
  def confirm_end(port), do: send_frame(port, "e")

  defp send_frame(port, frame) do
    Port.command(port, frame, [:nosuspend])
  rescue
    # The guard has exited.
    ArgumentError -> false
  end

  @doc "Continues a watch that a signal has halted. It then ends a guard that is halted too."
  @spec wake(port()) :: :ok | {:error, term()}
  def wake(port) do
    _ = System.cmd("kill", ["-s", "CONT", to_string(os_pid(port))], stderr_to_stdout: true)
    :ok
  rescue
    error in ErlangError -> {:error, error.original}
  end

  @doc "Returns the process number of the guard's watch, or 0 when it has exited."
  @spec os_pid(port()) :: non_neg_integer()
  def os_pid(port) do
    case Port.info(port, :os_pid) do
      {:os_pid, os_pid} -> os_pid
      nil -> 0
    end
  end

  @doc "Closes the port."
  @spec close(port()) :: :ok
  def close(port) do
    Port.close(port)
    :ok
  rescue
    ArgumentError -> :ok
  end
end

defmodule BB.Test.Native do
  @moduledoc "Unique ring topics for tests, and the processes of the operating system."

  alias BB.Test.Run

  @doc "Returns an unused topic name; its file is removed when the test ends."
  def topic(label \\ "t") do
    topic = Run.unique(label)
    ExUnit.Callbacks.on_exit(fn -> File.rm("/dev/shm/conduit_#{topic}") end)
    topic
  end

  @doc "Returns the process numbers of `program` with `argument` in its command line."
  def processes(program, argument) do
    for entry <- File.ls!("/proc"),
        entry =~ ~r/\A\d+\z/,
        {:ok, line} <- [File.read("/proc/#{entry}/cmdline")],
        [command | arguments] <- [String.split(line, <<0>>)],
        Path.basename(command) == program and argument in arguments,
        do: String.to_integer(entry)
  end

  @doc "Returns all descendants of a process."
  def descendants(os_pid) do
    for {pid, %{parent: ^os_pid}} <- table(),
        descendant <- [pid | descendants(pid)],
        do: descendant
  end

  @doc "Tells whether a process runs and is no zombie."
  def running?(os_pid), do: match?(%{^os_pid => %{state: state}} when state != "Z", table())

  @doc "Returns the state of a process from the kernel: R, S, T, …; `nil` if it does not exist."
  def state(os_pid) do
    with %{^os_pid => %{state: state}} <- table(), do: state, else: (_ -> nil)
  end

  @doc ~S[Sends a signal to a process: `signal("STOP", os_pid)`.]
  def signal(name, os_pid), do: {_, 0} = System.cmd("kill", ["-s", name, to_string(os_pid)])

  defp table do
    for entry <- File.ls!("/proc"),
        entry =~ ~r/\A\d+\z/,
        {:ok, stat} <- [File.read("/proc/#{entry}/stat")],
        # The name of the command is in parentheses and may contain any character.
        [state, parent | _] <- [stat |> String.split(") ") |> List.last() |> String.split()],
        into: %{},
        do: {String.to_integer(entry), %{state: state, parent: String.to_integer(parent)}}
  end

  @doc "Kills a process as the kernel's out-of-memory killer would."
  def kill_9(os_pid), do: {_, 0} = System.cmd("kill", ["-9", to_string(os_pid)])

  @doc "Kills a process that may end by itself at any moment."
  def end_by_force(os_pid),
    do: System.cmd("kill", ["-9", to_string(os_pid)], stderr_to_stdout: true)

  @doc "Returns the folder of real recordings, or `nil` if it does not exist."
  def shared_data(name) do
    path = Path.expand("../../../shared/data/#{name}", __DIR__)
    if File.exists?(path), do: path
  end
end

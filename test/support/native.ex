defmodule BB.Test.Native do
  @moduledoc "Native processes and ring topics of tests: names of their own, and a look at the system's processes."

  alias BB.Test.Run

  @doc "A topic name that nobody else uses; its file is removed when the test ends."
  def topic(label \\ "t") do
    topic = Run.unique(label)
    ExUnit.Callbacks.on_exit(fn -> File.rm("/dev/shm/conduit_#{topic}") end)
    topic
  end

  @doc "The operating system's numbers of the processes that run `program` with `argument` in their command line."
  def processes(program, argument) do
    for entry <- File.ls!("/proc"),
        entry =~ ~r/\A\d+\z/,
        {:ok, line} <- [File.read("/proc/#{entry}/cmdline")],
        [command | arguments] <- [String.split(line, <<0>>)],
        Path.basename(command) == program and argument in arguments,
        do: String.to_integer(entry)
  end

  @doc "The processes that a process has started, and those that they have."
  def descendants(os_pid) do
    for {pid, %{parent: ^os_pid}} <- table(),
        descendant <- [pid | descendants(pid)],
        do: descendant
  end

  @doc "Whether there is such a process, and it is more than an entry that nobody has collected yet."
  def running?(os_pid), do: match?(%{^os_pid => %{state: state}} when state != "Z", table())

  @doc "The state of a process as the kernel gives it: R, S, T, …; `nil` when there is none."
  def state(os_pid) do
    with %{^os_pid => %{state: state}} <- table(), do: state, else: (_ -> nil)
  end

  @doc ~S[Sends a signal to a process: `signal("STOP", os_pid)`.]
  def signal(name, os_pid), do: {_, 0} = System.cmd("kill", ["-s", name, to_string(os_pid)])

  defp table do
    for entry <- File.ls!("/proc"),
        entry =~ ~r/\A\d+\z/,
        {:ok, stat} <- [File.read("/proc/#{entry}/stat")],
        # The command's name stands in parentheses and may hold anything.
        [state, parent | _] <- [stat |> String.split(") ") |> List.last() |> String.split()],
        into: %{},
        do: {String.to_integer(entry), %{state: state, parent: String.to_integer(parent)}}
  end

  @doc "Kills a process as the kernel's out-of-memory killer would."
  def kill_9(os_pid), do: {_, 0} = System.cmd("kill", ["-9", to_string(os_pid)])

  @doc "Kills the process if it still is there; it may end by itself at any moment."
  def end_by_force(os_pid),
    do: System.cmd("kill", ["-9", to_string(os_pid)], stderr_to_stdout: true)

  @doc "The folder of real recordings, or nil where it is not beside the project."
  def shared_data(name) do
    path = Path.expand("../../../shared/data/#{name}", __DIR__)
    if File.exists?(path), do: path
  end
end

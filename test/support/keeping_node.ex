defmodule BB.Test.KeepingNode do
  @moduledoc """
  A VM of its own in which fifty processes set parameters until it is killed.

  It is its own robot, whose store is the file `KEEPING_FILE`. Each process sets a pair of
  parameters to the same increasing number. It appends every acknowledged pair to the file
  `KEEPING_ACKNOWLEDGED`, at once and without buffering in the VM. The VM prints `ready` when it
  has started, and begins when it receives a line.
  """

  alias BB.Parameter
  alias BB.Parameter.Definition

  @writers 50

  @doc "Starts a VM. It belongs to the calling process, and sends messages as a port does."
  def start(store, file, acknowledged) do
    env =
      for {name, value} <- [STORE: store, FILE: file, ACKNOWLEDGED: acknowledged],
          do: {~c"KEEPING_#{name}", to_charlist(value)}

    paths = for app <- [:elixir, :logger, :ganglion], do: Application.app_dir(app, "ebin")
    vm = ~w(-noshell -boot start_clean +S 2:2 +sbwt none +A 1)
    run = ["-s", Atom.to_string(__MODULE__), "main"]
    erl = System.find_executable("erl")
    opts = [:binary, :exit_status, {:line, 1_000}, env: env, args: vm ++ ["-pa" | paths] ++ run]
    Port.open({:spawn_executable, erl}, opts)
  end

  @doc "Kills a VM with SIGKILL, and returns when it is gone."
  def kill(port) do
    {:os_pid, pid} = Port.info(port, :os_pid)

    # A VM that has ended by itself reports its status.
    _ = System.cmd("kill", ["-KILL", "#{pid}"], stderr_to_stdout: true)

    receive do
      {^port, {:exit_status, 137}} -> :ok
      {^port, {:exit_status, status}} -> raise "the VM ended by itself with status #{status}"
    end
  end

  @doc "Returns the acknowledged values: the newest number of each pair."
  def acknowledged(file) do
    with {:ok, bytes} <- File.read(file) do
      for <<writer::16, number::48 <- bytes>>, into: %{}, do: {writer, number}
    else
      {:error, :enoent} -> %{}
    end
  end

  @doc "Returns the paths of a pair."
  def pair(writer), do: [[:"left#{writer}"], [:"right#{writer}"]]

  @doc "Returns the numbers of all writers."
  def writers, do: 1..@writers

  @doc false
  def main do
    {:ok, _} = Application.ensure_all_started(:logger)
    # Modules that are loaded now take no time later, during the kills.
    :ok = Application.load(:ganglion)
    {:ok, modules} = :application.get_key(:ganglion, :modules)
    ours = for module <- modules, String.starts_with?(inspect(module), "BB.Parameter"), do: module
    :ok = :code.ensure_modules_loaded([BB.Message, BB.PubSub, BB.Options | ours])
    spawn(&work/0)
  end

  defp work do
    Process.flag(:trap_exit, true)
    IO.puts("ready")
    await_line()
    {:ok, _} = Parameter.Supervisor.start_link({__MODULE__, %{}, []})
    for writer <- writers(), do: spawn_link(fn -> write(writer) end)
    spawn_link(&await_line/0)

    receive do
      {:EXIT, _pid, _reason} -> System.halt(1)
    end
  end

  # The VM ends with the VM that started it.
  defp await_line do
    if IO.read(:stdio, :line) == :eof, do: System.halt(0)
  end

  @doc false
  def robot do
    parameters =
      for writer <- writers(), path <- pair(writer) do
        {:ok, definition} = Definition.new(path, type: :integer, default: 0)
        definition
      end

    store = String.to_existing_atom(System.fetch_env!("KEEPING_STORE"))
    file = System.fetch_env!("KEEPING_FILE")
    %{parameters: parameters, settings: %{parameter_store: {store, path: file}}}
  end

  defp write(writer) do
    file = System.fetch_env!("KEEPING_ACKNOWLEDGED")
    {:ok, acknowledged} = :file.open(file, [:append, :raw, :binary])
    [left, _right] = paths = pair(writer)
    write(paths, writer, Parameter.get!(__MODULE__, left) + 1, acknowledged)
  end

  defp write(paths, writer, number, acknowledged) do
    :ok = Parameter.set_many(__MODULE__, Enum.map(paths, &{&1, number}))
    :ok = :file.write(acknowledged, <<writer::16, number::48>>)
    write(paths, writer, number + 1, acknowledged)
  end
end

defmodule BB.Test.Application do
  @moduledoc """
  Starts, stops and kills the application `:ganglion` for a test.

  Such a test runs alone (`async: false`) and calls `restore/0` when it exits.
  """

  import BB.Test.Eventually

  @app :ganglion
  @settings [:robot, BB.Firmware.Guard]

  @doc "Returns the application's own process, above its supervisor."
  def host do
    {:dictionary, dictionary} =
      Ganglion.Supervisor |> Process.whereis() |> Process.info(:dictionary)

    hd(dictionary[:"$ancestors"])
  end

  @doc "Restarts the application with a robot in it."
  def start_with(robot) do
    :ok = stop()
    Application.put_env(@app, :robot, robot)
    # The topic is unique, because all robots of a machine share the ring.
    Application.put_env(@app, BB.Firmware.Guard, topic: "guard_#{:rand.uniform(1_000_000_000)}")
    start()
  end

  @doc "Starts the application."
  def start do
    {:ok, _} = Application.ensure_all_started(@app)
    :ok
  end

  @doc "Stops the application."
  def stop, do: Application.stop(@app)

  @doc "Waits for the end of the application."
  def await_end, do: eventually(fn -> not running?() end, 30_000)

  @doc "Tells whether the application runs."
  def running?, do: List.keymember?(Application.started_applications(), @app, 0)

  @doc "Restores the configuration of the tests and starts the application."
  def restore do
    if Enum.any?(@settings, &(Application.get_env(@app, &1) != nil)) do
      _ = stop()
      Enum.each(@settings, &Application.delete_env(@app, &1))
    end

    start()
  end

  @doc "Returns all processes below a supervisor, and itself: `{path of ids, pid}`."
  def tree(supervisor, path \\ []) do
    pid = if is_atom(supervisor), do: Process.whereis(supervisor), else: supervisor

    below =
      for {id, child, type, _} <- children(pid), is_pid(child), type in [:supervisor, :worker] do
        if type == :supervisor, do: tree(child, path ++ [id]), else: [{path ++ [id], child}]
      end

    [{path, pid} | Enum.concat(below)]
  end

  # A process may end while its siblings are listed.
  defp children(pid) do
    Supervisor.which_children(pid)
  catch
    :exit, _reason -> []
  end

  @doc "Kills a process, and returns when it has ended."
  def kill(pid) do
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
  end

  @doc "Kills the process with the name, `times` times, each as soon as a process has the name."
  def kill(name, times) do
    for _ <- 1..times, do: kill(eventually(fn -> Process.whereis(name) end, 30_000))
    :ok
  end
end

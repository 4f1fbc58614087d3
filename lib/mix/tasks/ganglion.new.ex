defmodule Mix.Tasks.Ganglion.New do
  @boards Enum.map_join(Ganglion.New.Options.boards(), ", ", fn {board, _} -> "`#{board}`" end)

  @shortdoc "Generates a project for a robot"
  @moduledoc """
  Generates a project for a robot that depends on Ganglion.

  The project runs on simulated buses at once, and on boards as firmware. In a checkout of
  Ganglion, `bin/new` runs this task.

      mix ganglion.new PATH [--module NAME] [--target BOARDS] [--from SOURCE] [--native KIND]
      bin/new ../rover

  PATH is a new or an empty folder. The application has the folder's name, and the robot the same
  name in camel case: `../my_rover` has the robot `MyRover`.

  | option | |
  |---|---|
  | `--module NAME` | the name of the robot's module |
  | `--target BOARDS` | the boards, separated by commas or in several options; by default all supported boards |
  | `--from SOURCE` | the dependency on Ganglion: the path of a checkout (by default the one that runs), or `git:URL`, or `git:URL#REF` with a branch, tag or commit |
  | `--native KIND` | the language of the native process: `rust` (the default), `python` (not for boards) or `none` |

  Supported boards: #{@boards}.

  ## The project

  `lib/<robot>.ex` is the robot, with its simulated devices. Beside it are a driver of its own,
  the driver's payload and its simulated chip. `test/` runs the robot, and runs the tests that
  every driver has to pass (`BB.Sensor.Conformance`). `native/` has a native process that
  publishes on the ring. `bin/demo` and `bin/test` install what is missing on the machine and run
  it all.

  `config/target.exs` imports Ganglion's `config/firmware.exs`, and `firmware/scripts` call
  Ganglion's scripts, so that an update of Ganglion updates both. All other files belong to the
  project.
  """

  use Mix.Task

  @impl Mix.Task
  def run(argv) do
    _ = load_eex()

    case Ganglion.New.run(argv, from: File.cwd!(), checkout: checkout()) do
      {:ok, report} -> Mix.shell().info(report)
      :help -> Mix.Task.run("help", ["ganglion.new"])
      {:error, sentence} -> Mix.raise(sentence)
    end
  end

  # Since Elixir 1.15, Mix removes applications from the code path that are no dependencies.
  defp load_eex do
    if function_exported?(Mix, :ensure_application!, 1),
      do: apply(Mix, :ensure_application!, [:eex])
  end

  # The project that runs, or its dependency.
  defp checkout do
    if Mix.Project.config()[:app] == :ganglion,
      do: File.cwd!(),
      else: Mix.Project.deps_paths()[:ganglion] || File.cwd!()
  end
end

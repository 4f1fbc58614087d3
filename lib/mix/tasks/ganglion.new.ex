defmodule Mix.Tasks.Ganglion.New do
  @shortdoc "Writes a project for a robot of your own"
  @moduledoc """
  Writes a project for a robot of your own, which runs on simulated buses at once, and on boards as firmware.

      mix ganglion.new PATH [--module NAME] [--target BOARDS] [--from SOURCE] [--native KIND]
      bin/new ../rover

  The project's application is called by the folder's name, and its robot by that in camel case: `../my_rover` has the robot
  `MyRover`. PATH is a new folder or an empty one.

  | option | |
  |---|---|
  | `--module NAME` | another name for the robot's module |
  | `--target BOARDS` | the boards that it is for, with commas between or one each time; all that are known without it |
  | `--from SOURCE` | where the project has Ganglion from: the path of a checkout (without it the one that asks), or `git:URL`, with `#REF` for a branch, tag or commit |
  | `--native KIND` | the native process in it: `rust`, as without it; `python`, which no board carries; `none` |

  Known boards: #{Enum.map_join(Ganglion.New.Options.boards(), ", ", fn {board, _} -> "`#{board}`" end)}.

  ## What is in it

  `lib/<robot>.ex` is the robot, with what hangs on its simulated buses; beside it a driver of its own, with its payload and its
  simulated chip. `test/` runs the robot and holds the driver to what every driver has to do (`BB.Sensor.Conformance`). `native/`
  has a native process that speaks through the ring. `bin/demo` and `bin/test` run it all on a machine with nothing installed.

  `config/target.exs` takes what every board shares from Ganglion's own `config/firmware.exs`, and `firmware/scripts` call
  Ganglion's scripts, so that an update of Ganglion reaches both. All other files are yours from the start.
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

  # Since 1.15 Mix takes away what the project does not depend on.
  defp load_eex do
    if function_exported?(Mix, :ensure_application!, 1),
      do: apply(Mix, :ensure_application!, [:eex])
  end

  # The project at hand, or the one that it depends on.
  defp checkout do
    if Mix.Project.config()[:app] == :ganglion,
      do: File.cwd!(),
      else: Mix.Project.deps_paths()[:ganglion] || File.cwd!()
  end
end

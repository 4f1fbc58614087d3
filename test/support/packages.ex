defmodule BB.Test.Packages do
  @moduledoc """
  Drivers in `test/support/packages/` as packages that depend on `:bb` are written. Each file is
  compiled as it is but for the names of the libraries of options and units.

      [PowerMonitor.Chip, PowerMonitor.Sensor] = BB.Test.Packages.compile!("power_monitor")

  A project that depends on `packages/bb` compiles the files unchanged (`test/project_test.exs`).
  """

  import ExUnit.CaptureIO

  @folder Path.expand("packages", __DIR__)

  @names %{
    "Spark.Options" => "BB.Options",
    "Localize.Unit" => "BB.Unit",
    "Spark.Error.DslError" => "BB.Dsl.Error"
  }

  @doc "Returns the text of a package, with the names that Beam Bots' own packages use."
  @spec text(String.t()) :: String.t()
  def text(package), do: File.read!(file(package))

  @doc "Compiles a package and returns its modules. Raises for a warning of the compiler."
  @spec compile!(String.t()) :: [module()]
  def compile!(package) do
    text = String.replace(text(package), Map.keys(@names), &@names[&1])
    {modules, warnings} = with_io(:stderr, fn -> Code.compile_string(text, file(package)) end)

    assert_none(package, warnings)
    for {module, _beam} <- modules, do: module
  end

  # The tests consolidate protocols before they compile packages. A project does not.
  defp assert_none(package, text) do
    case for(warning <- String.split(text, "\n\n"), warning =~ ~r/\S/, do: warning)
         |> Enum.reject(&(&1 =~ "has already been consolidated")) do
      [] -> :ok
      warnings -> raise "#{package} has warnings:\n#{Enum.join(warnings, "\n\n")}"
    end
  end

  defp file(package), do: Path.join(@folder, package <> ".exs")
end

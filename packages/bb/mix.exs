defmodule BB.MixProject do
  use Mix.Project

  # The version of Beam Bots' API that Ganglion has, not a version of Ganglion. Packages that
  # depend on `:bb` ask for it.
  @version "0.31.0"

  def project do
    [
      app: :bb,
      version: @version,
      elixir: "~> 1.14",
      deps: [{:ganglion, path: "../.."}] ++ libraries(Mix.target())
    ]
  end

  def application, do: [mod: {BB.Application, []}, extra_applications: [:logger]]

  # Drivers call these libraries through `:bb`, and do not list them. Without Hex, which only
  # boards need, the host has the thin modules of this package instead of Spark.
  defp libraries(:host) do
    if Code.ensure_loaded?(Hex), do: [{:spark, "~> 2.2", optional: true}], else: []
  end

  defp libraries(_board), do: [{:spark, "~> 2.2"}, {:telemetry, "~> 1.0"}]
end

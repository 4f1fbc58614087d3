defmodule BB.Component.OptionsCheck do
  @moduledoc """
  The options of components, as `BB.Component.Resolution` makes them, where the check may itself
  be wrong: a module's `options_schema/0` and the functions of its `:custom` types are code of
  others.
  """

  alias BB.Callback
  alias BB.Component.Resolution
  alias BB.Options.ValidationError

  # A check may look at hardware; it should not have to.
  @timeout_ms 2_000

  @typedoc "`{:unchecked_options, words}`: nobody knows whether the options are right, and why."
  @type result ::
          {:ok, keyword()} | {:error, ValidationError.t() | {:unchecked_options, String.t()}}

  @doc """
  The options of several components with their parameters' values, in their order. All are checked
  at once.
  """
  @spec run([{Resolution.t(), Resolution.values()}]) :: [result()]
  def run(resolutions) do
    resolutions |> Enum.map(&start/1) |> Enum.map(&await/1)
  end

  defp start({resolution, values}) do
    Callback.start({Resolution, :options, [resolution, values]},
      name: "the check of the options of #{inspect(resolution.module)}",
      instead: "the component is down until its options can be checked",
      timeout_ms: @timeout_ms,
      remember: false
    )
  end

  defp await(call) do
    case Callback.await(call) do
      {:ok, checked} -> checked
      {:error, failure} -> {:error, {:unchecked_options, Callback.format_failure(failure)}}
    end
  end
end

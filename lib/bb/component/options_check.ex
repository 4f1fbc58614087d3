defmodule BB.Component.OptionsCheck do
  @moduledoc """
  Checks the options of components by `BB.Component.Resolution`, in bounded time.

  `BB.Component.Server` uses it when a component starts or a parameter changes, and
  `BB.Supervisor` when a robot starts. The check calls code of others, a module's
  `options_schema/0` and the functions of its `:custom` types, and so runs by `BB.Callback`.
  """
  @moduledoc no_example: "internal: a component's options are checked when its robot starts"

  alias BB.Callback
  alias BB.Component.Resolution
  alias BB.Options.ValidationError

  # A check may read hardware, though none should.
  @timeout_ms 2_000

  @typedoc """
  The result of one check. `{:unchecked_options, text}` says that the check itself failed, and
  why.
  """
  @type result ::
          {:ok, keyword()} | {:error, ValidationError.t() | {:unchecked_options, String.t()}}

  @doc """
  Checks the options of several components at the same time.

  Returns the results in the order of the components.
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

defmodule BB.Diagnostic do
  @moduledoc """
  What a component says about its condition, as a telemetry event for dashboards and logs.

  A driver publishes one when its hardware reports its temperature, its voltage or an alert:

      iex> test = self()
      iex> handler = fn _event, _measurements, diagnostic, _config -> send(test, diagnostic) end
      iex> BB.Telemetry.attach("diagnostics", [:bb, :diagnostic], handler, nil)
      iex> BB.Diagnostic.warn([:arm, :servo], "hot", values: %{celsius: 71})
      :ok
      iex> receive do: (%BB.Diagnostic{level: :warn} = d -> {d.component, d.message, d.values})
      {[:arm, :servo], "hot", %{celsius: 71}}
      iex> BB.Telemetry.detach("diagnostics")
      :ok

  The event is `[:bb, :diagnostic]`, without measurements; its metadata is the struct. Levels are
  `:ok`, `:warn`, `:error` and `:stale`, as in ROS. For a fault on which the robot acts, use
  `BB.Safety.report_error/3`.
  """

  alias BB.Telemetry

  @levels [:ok, :warn, :error, :stale]

  @enforce_keys [:component, :level, :message]
  defstruct [:component, :level, :message, :timestamp, values: %{}]

  @type level :: :ok | :warn | :error | :stale

  @type t :: %__MODULE__{
          component: [atom()],
          level: level(),
          message: String.t(),
          values: map(),
          timestamp: DateTime.t()
        }

  @type option :: {:values, map()} | {:timestamp, DateTime.t()}

  @doc """
  Creates a diagnostic.

  `component:`, a path, `level:` and `message:` are required: it raises `KeyError` without them.
  `values:` is a map (default: empty), and `timestamp:` a `DateTime` (default: now, in UTC).

      iex> BB.Diagnostic.new(component: [:imu], level: :ok, message: "calibrated").values
      %{}
  """
  @spec new(keyword()) :: t()
  def new(fields) when is_list(fields) do
    %__MODULE__{
      component: Keyword.fetch!(fields, :component),
      level: fields |> Keyword.fetch!(:level) |> level!(),
      message: Keyword.fetch!(fields, :message),
      values: Keyword.get(fields, :values, %{}),
      timestamp: Keyword.get_lazy(fields, :timestamp, &DateTime.utc_now/0)
    }
  end

  defp level!(level) when level in @levels, do: level

  defp level!(level),
    do: raise(ArgumentError, "expected a level of #{inspect(@levels)}, got: #{inspect(level)}")

  @doc "Publishes a diagnostic, or the diagnostic that `new/1` creates of the fields."
  @spec publish(t() | keyword()) :: :ok
  def publish(%__MODULE__{} = diagnostic),
    do: Telemetry.emit([:bb, :diagnostic], %{}, diagnostic)

  def publish(fields) when is_list(fields), do: fields |> new() |> publish()

  @doc "Publishes that all is well."
  @spec ok([atom()], String.t(), [option()]) :: :ok
  def ok(component, message, opts \\ []), do: publish(component, :ok, message, opts)

  @doc "Publishes a warning."
  @spec warn([atom()], String.t(), [option()]) :: :ok
  def warn(component, message, opts \\ []), do: publish(component, :warn, message, opts)

  @doc "Publishes an error."
  @spec error([atom()], String.t(), [option()]) :: :ok
  def error(component, message, opts \\ []), do: publish(component, :error, message, opts)

  @doc "Publishes that the component has not been heard of for too long."
  @spec stale([atom()], String.t(), [option()]) :: :ok
  def stale(component, message, opts \\ []), do: publish(component, :stale, message, opts)

  defp publish(component, level, message, opts) do
    opts
    |> Keyword.take([:values, :timestamp])
    |> Keyword.merge(component: component, level: level, message: message)
    |> publish()
  end
end

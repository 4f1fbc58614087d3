defmodule BB.Estimator.Inputs do
  @moduledoc """
  The inputs of an estimator, and what it is given for a message. Pure. `BB.Estimator.Server`
  keeps one for each estimator.

  A message of the only input is given as it is. With several inputs the message of the driver
  comes with the newest message of each other one, by the inputs' names. None of them may be
  missing, or differ in time from the driver's by more than the tolerance.
  """
  @moduledoc no_example: "internal: BB.Estimator shows its results"

  alias BB.Message

  @enforce_keys [:declared]
  defstruct [:declared, :tolerance_ns, newest: %{}]

  @type t :: %__MODULE__{
          declared: [BB.Component.input()],
          tolerance_ns: non_neg_integer() | nil,
          newest: %{atom() => Message.t()}
        }

  @doc "Returns the inputs of a declaration."
  @spec new([BB.Component.input()], non_neg_integer() | nil) :: t()
  def new(declared, tolerance_ns),
    do: %__MODULE__{declared: declared, tolerance_ns: tolerance_ns}

  @doc "Returns the input whose topic is a path, or `nil`."
  @spec find(t(), [atom()]) :: BB.Component.input() | nil
  def find(%{declared: declared}, path), do: Enum.find(declared, &(&1.path == path))

  @doc "Returns whether a message of the input triggers the estimator."
  @spec trigger?(t(), BB.Component.input()) :: boolean()
  def trigger?(%{declared: [_one]}, _input), do: true
  def trigger?(_inputs, input), do: input.driver?

  @doc """
  Takes a message: what the estimator is given, `:stored` for one of an input that does not
  trigger it, or `:sync_miss`.
  """
  @spec take(t(), BB.Component.input(), Message.t()) ::
          {{:given, Message.t() | %{atom() => Message.t()}} | :stored | :sync_miss, t()}
  def take(%{declared: [_one]} = inputs, _input, message), do: {{:given, message}, inputs}

  def take(inputs, input, message) do
    inputs = put_in(inputs.newest[input.name], message)
    {if(input.driver?, do: combine(inputs, message), else: :stored), inputs}
  end

  defp combine(%{declared: declared, newest: newest} = inputs, message) do
    if Enum.all?(declared, &near?(newest[&1.name], message, inputs.tolerance_ns)),
      do: {:given, newest},
      else: :sync_miss
  end

  defp near?(nil, _driver, _tolerance_ns), do: false
  defp near?(_message, _driver, nil), do: true

  defp near?(message, driver, tolerance_ns),
    do: abs(message.monotonic_time - driver.monotonic_time) <= tolerance_ns
end

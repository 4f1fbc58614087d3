defmodule BB.Estimator.Health do
  @moduledoc """
  The health of an estimator as a state machine. Pure. `BB.Estimator.Server` keeps one for each
  estimator, and acts on the changes.

      iex> alias BB.Estimator.Health
      iex> {:changed, health, :sync_miss} = Health.bad(Health.new(2), :sync_miss)
      iex> health.state
      :degraded
      iex> {:same, health} = Health.good(health)
      iex> {:changed, %{state: :healthy}, :recovered} = Health.good(health)

  | state | event | next state | reason |
  |---|---|---|---|
  | `:healthy`, `:lost` | a bad input | `:degraded` | that of the input |
  | `:degraded` | so many good inputs in a row as `recover_after` says | `:healthy` | `:recovered` |
  | `:healthy`, `:degraded` | no input for too long | `:lost` | `:lost` |
  | `:lost` | a good input | `:degraded` | `:input_resumed` |
  """

  defstruct state: :healthy, recover_after: 1, good: 0

  @type state :: :healthy | :degraded | :lost
  @type reason :: :latency_overrun | :sync_miss | :recovered | :lost | :input_resumed
  @type t :: %__MODULE__{
          state: state(),
          recover_after: pos_integer(),
          good: non_neg_integer()
        }

  @typedoc "The health after an event."
  @type change :: {:same, t()} | {:changed, t(), reason()}

  @doc "Returns the health of an estimator that starts."
  @spec new(pos_integer()) :: t()
  def new(recover_after), do: %__MODULE__{recover_after: recover_after}

  @doc "Handles an input that the estimator has handled well."
  @spec good(t()) :: change()
  def good(%{state: :healthy} = health), do: {:same, health}

  def good(%{state: :lost} = health),
    do: {:changed, %{health | state: :degraded, good: 0}, :input_resumed}

  def good(%{good: good, recover_after: recover_after} = health) when good + 1 >= recover_after,
    do: {:changed, %{health | state: :healthy, good: 0}, :recovered}

  def good(health), do: {:same, %{health | good: health.good + 1}}

  @doc "Handles an input that was late or without its companions."
  @spec bad(t(), reason()) :: change()
  def bad(%{state: :degraded} = health, _reason), do: {:same, %{health | good: 0}}
  def bad(health, reason), do: {:changed, %{health | state: :degraded, good: 0}, reason}

  @doc "Handles that there was no input for too long."
  @spec silent(t()) :: change()
  def silent(%{state: :lost} = health), do: {:same, health}
  def silent(health), do: {:changed, %{health | state: :lost, good: 0}, :lost}
end

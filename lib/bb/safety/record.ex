defmodule BB.Safety.Record do
  @moduledoc """
  All that is known of a robot's safety, and what each request makes of it. Pure.

    * `:state` - `:disarmed`, `:armed`, `:disarming` or `:error`
    * `:epoch` - the number of the latest arming, 0 before the first
    * `:root`, `:topology` - the processes whose death ends an arming; `nil` while there is none
    * `:round` - the disarming under way
    * `:failures` - what the latest disarming could not make safe
    * `:by` - the request that led to this state. One that is repeated, because the process that
      carried it out died before it answered, finds itself here and is not carried out twice
  """

  alias BB.Safety.Round

  @enforce_keys [:robot]
  defstruct [:robot, :root, :topology, :round, :by, state: :disarmed, epoch: 0, failures: []]

  @type state :: :disarmed | :armed | :disarming | :error
  @type role :: :root | :topology

  @type t :: %__MODULE__{
          robot: module(),
          root: pid() | nil,
          topology: pid() | nil,
          round: Round.t() | nil,
          by: reference() | nil,
          state: state(),
          epoch: non_neg_integer(),
          failures: [Round.failure()]
        }

  @doc """
  Arms it, with a new `epoch`. At a repeated request `seen` is the epoch before the first attempt:
  when it has passed, that attempt or another's succeeded and may have been undone since, so this
  one does nothing. `:not_running` forbids it like an inhibition.
  """
  @spec arm(
          t(),
          reference(),
          :first | :error | non_neg_integer(),
          pos_integer(),
          list() | :not_running
        ) :: {:ok, t()} | {:error, term()}
  def arm(%{by: ref} = record, ref, _seen, _epoch, _inhibitions), do: {:ok, record}

  def arm(%{state: :disarmed, root: nil}, _ref, _seen, _epoch, _inhibitions),
    do: {:error, :not_registered}

  def arm(%{state: :disarmed, epoch: passed}, _ref, seen, _epoch, _inhibitions)
      when is_integer(seen) and seen != passed,
      do: {:error, :already_armed}

  def arm(%{state: :disarmed} = record, ref, _seen, epoch, []),
    do: {:ok, %{record | state: :armed, epoch: epoch, by: ref, failures: []}}

  def arm(%{state: :disarmed}, _ref, _seen, _epoch, :not_running), do: {:error, :not_running}

  def arm(%{state: :disarmed}, _ref, _seen, _epoch, inhibitions),
    do: {:error, {:inhibited, inhibitions}}

  def arm(%{state: :armed}, _ref, _seen, _epoch, _inhibitions), do: {:error, :already_armed}
  def arm(%{state: :disarming}, _ref, _seen, _epoch, _inhibitions), do: {:error, :disarming}
  def arm(%{state: :error}, _ref, _seen, _epoch, _inhibitions), do: {:error, :in_error}

  @doc """
  What a request to disarm comes to: `:begin`, `:wait` for the round that it began already, or an
  answer.
  """
  @spec disarm(t(), reference()) :: :begin | :wait | :ok | {:error, term()}
  def disarm(%{state: :armed}, _ref), do: :begin
  def disarm(%{state: :disarming, by: ref}, ref), do: :wait
  def disarm(%{by: ref} = record, ref), do: outcome(record)
  def disarm(%{state: :disarmed}, _ref), do: {:error, :already_disarmed}
  def disarm(%{state: :disarming}, _ref), do: {:error, :already_disarming}
  def disarm(%{state: :error}, _ref), do: {:error, :already_in_error}

  @doc "A disarming begins."
  @spec disarming(t(), reference() | nil, Round.t()) :: t()
  def disarming(%{state: :armed} = record, ref, round),
    do: %{record | state: :disarming, by: ref, round: round}

  @doc "The disarming is over."
  @spec disarmed(t(), [Round.failure()]) :: t()
  def disarmed(%{state: :disarming} = record, failures) do
    state = if failures == [], do: :disarmed, else: :error
    %{record | state: state, round: nil, failures: failures}
  end

  @doc "How the latest disarming ended."
  @spec outcome(t()) :: :ok | {:error, {:disarm_failed, [Round.failure(), ...]}}
  def outcome(%{failures: []}), do: :ok
  def outcome(%{failures: failures}), do: {:error, {:disarm_failed, failures}}

  @doc "A person vouches for the hardware."
  @spec force_disarm(t(), reference()) :: {:ok, t()} | {:error, :not_in_error}
  def force_disarm(%{by: ref} = record, ref), do: {:ok, record}

  def force_disarm(%{state: :error} = record, ref),
    do: {:ok, %{record | state: :disarmed, failures: [], by: ref}}

  def force_disarm(_record, _ref), do: {:error, :not_in_error}

  @doc "A process takes a role. A new root has no topology yet."
  @spec enter(t(), role(), pid()) :: t()
  def enter(record, :root, pid), do: %{record | root: pid, topology: nil}
  def enter(record, :topology, pid), do: %{record | topology: pid}

  @doc "The processes with a role."
  @spec watched(t()) :: [{role(), pid()}]
  def watched(record),
    do: for(role <- [:root, :topology], pid = Map.fetch!(record, role), do: {role, pid})

  @doc "Nothing is left to watch, and nothing to remember."
  @spec over?(t()) :: boolean()
  def over?(record), do: record.root == nil and record.state == :disarmed
end

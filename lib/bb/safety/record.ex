defmodule BB.Safety.Record do
  @moduledoc """
  The safety record of one robot, and the effect of each request on it. Pure; `BB.Safety.Warden`
  uses it.

    * `:state` - `:disarmed`, `:armed`, `:disarming` or `:error`
    * `:epoch` - the number of the latest arming, 0 before the first
    * `:root`, `:topology` - the supervisors whose death disarms the robot, `nil` for none
    * `:round` - the disarming in progress
    * `:failures` - the failures of the latest disarming
    * `:by` - the request that led to this state. A request is repeated when the warden dies
      before it replies; the repeated request is recognised by this field and not executed twice

      iex> record = %BB.Safety.Record{robot: MyRobot, root: self()}
      iex> {:ok, armed} = BB.Safety.Record.arm(record, make_ref(), :first, 1, [])
      iex> armed.state
      :armed
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
  Arms the robot, with a new `epoch`.

  `seen` is `:first` for a first attempt. For a repeated request it is the epoch before the first
  attempt: when the epoch has changed since, an attempt has succeeded and may have been undone, so
  the repeated request does nothing. `:not_running` forbids arming, as an inhibition does.
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
  Decides about a request to disarm: `:begin` a round, `:wait` for the round that the same request
  has begun, or the reply.
  """
  @spec disarm(t(), reference()) :: :begin | :wait | :ok | {:error, term()}
  def disarm(%{state: :armed}, _ref), do: :begin
  def disarm(%{state: :disarming, by: ref}, ref), do: :wait
  def disarm(%{by: ref} = record, ref), do: outcome(record)
  def disarm(%{state: :disarmed}, _ref), do: {:error, :already_disarmed}
  def disarm(%{state: :disarming}, _ref), do: {:error, :already_disarming}
  def disarm(%{state: :error}, _ref), do: {:error, :already_in_error}

  @doc """
  Decides about a request to move the robot to `:error`: `:begin` a round, `:wait` for the round
  in progress, or the reply.
  """
  @spec fail(t()) :: :begin | :wait | :ok | {:error, :already_disarmed}
  def fail(%{state: :armed}), do: :begin
  def fail(%{state: :disarming}), do: :wait
  def fail(%{state: :error}), do: :ok
  def fail(%{state: :disarmed}), do: {:error, :already_disarmed}

  @doc "Returns the record of an armed robot whose disarming begins."
  @spec disarming(t(), reference() | nil, Round.t()) :: t()
  def disarming(%{state: :armed} = record, ref, round),
    do: %{record | state: :disarming, by: ref, round: round}

  @doc """
  Returns the record of a robot whose disarming is over.

  After a failure of a handler, the death of the topology or a request for it the state is
  `:error`.
  """
  @spec disarmed(t(), [Round.failure()]) :: t()
  def disarmed(%{state: :disarming, round: %{cause: cause}} = record, failures) do
    safe? = failures == [] and cause not in [:failure, {:topology, :ended}]
    state = if safe?, do: :disarmed, else: :error
    %{record | state: state, round: nil, failures: failures}
  end

  @doc "Returns the result of the latest disarming."
  @spec outcome(t()) :: :ok | {:error, {:disarm_failed, [Round.failure(), ...]}}
  def outcome(%{failures: []}), do: :ok
  def outcome(%{failures: failures}), do: {:error, {:disarm_failed, failures}}

  @doc "Moves the record from `:error` to `:disarmed`."
  @spec force_disarm(t(), reference()) :: {:ok, t()} | {:error, :not_in_error}
  def force_disarm(%{by: ref} = record, ref), do: {:ok, record}

  def force_disarm(%{state: :error} = record, ref),
    do: {:ok, %{record | state: :disarmed, failures: [], by: ref}}

  def force_disarm(_record, _ref), do: {:error, :not_in_error}

  @doc "Gives a role to a process. A new root has no topology yet."
  @spec enter(t(), role(), pid()) :: t()
  def enter(record, :root, pid), do: %{record | root: pid, topology: nil}
  def enter(record, :topology, pid), do: %{record | topology: pid}

  @doc "Returns the processes with a role."
  @spec watched(t()) :: [{role(), pid()}]
  def watched(record),
    do: for(role <- [:root, :topology], pid = Map.fetch!(record, role), do: {role, pid})

  @doc "Returns whether the robot has ended and is disarmed, so that its warden can end."
  @spec over?(t()) :: boolean()
  def over?(record), do: record.root == nil and record.state == :disarmed
end

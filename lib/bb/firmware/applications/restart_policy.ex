defmodule BB.Firmware.Applications.RestartPolicy do
  @moduledoc """
  What follows when an application ends: it is started again, then the board is. Pure; the clock
  is an argument, in milliseconds.

  An application that has ended is started again, at once the first time and after a longer pause
  each time, up to `restarts` times within `window_ms`. When it ends once more, that does not
  help, and the board is restarted.

  The board is restarted `board_restarts` times at most: one that restarts for ever takes no
  update. After that the board stays up without the application, which is started again once in
  `stay_ms`. Where it is not known how often the board was restarted, it stays up as well.
  `calm_ms` without an end count as success, and counting begins anew.

  Firmware on trial is not restarted but reverted.

      iex> alias BB.Firmware.Applications.RestartPolicy
      iex> {policy, {:start, 1, 0}} = RestartPolicy.ended(RestartPolicy.new([]), :ganglion, :killed, 0)
      iex> {_decision, {:start, 2, 1_000}} = RestartPolicy.ended(policy, :ganglion, :killed, 400)

  An application that a person has stopped stays stopped (reason `:stopped`).
  """

  @schema BB.Options.new!(
            pauses_ms: [
              type: {:list, :non_neg_integer},
              default: [0, 1_000, 5_000, 15_000],
              doc: "How long each start waits, in milliseconds; as many as there are starts."
            ],
            window_ms: [
              type: :pos_integer,
              default: 300_000,
              doc: "The time within which ends are counted, in milliseconds."
            ],
            board_restarts: [
              type: :non_neg_integer,
              default: 3,
              doc: "How often the board is restarted for the sake of an application."
            ],
            stay_ms: [
              type: :pos_integer,
              default: 60_000,
              doc: "How long a start waits once the board is not restarted any more."
            ],
            calm_ms: [
              type: :pos_integer,
              default: 600_000,
              doc: "How long everything has to run to count as success."
            ]
          )

  @enforce_keys [:opts]
  defstruct [:opts, ends: %{}]

  @type t :: %__MODULE__{}

  @typedoc """
  The n-th start, after a pause; that starting does not help any more; or nothing.
  """
  @type step :: {:start, n :: pos_integer(), pause_ms :: non_neg_integer()} | :give_up | :nothing

  @typedoc "What is done once starting does not help."
  @type last_step :: :revert | :restart_board | {:stay, pause_ms :: pos_integer()}

  @doc "Begins. Options:\n\n#{BB.Options.docs(@schema)}"
  @spec new(keyword()) :: t()
  def new(opts), do: %__MODULE__{opts: Map.new(BB.Options.validate!(opts, @schema))}

  @doc "How often an application is started again."
  @spec starts(t()) :: non_neg_integer()
  def starts(policy), do: length(policy.opts.pauses_ms)

  @doc "An application has ended, or did not start."
  @spec ended(t(), atom(), reason :: term(), integer()) :: {t(), step()}
  def ended(policy, app, :stopped, _now_ms),
    do: {%{policy | ends: Map.delete(policy.ends, app)}, :nothing}

  def ended(%{opts: opts} = policy, app, _reason, now_ms) do
    recent = for at <- Map.get(policy.ends, app, []), now_ms - at < opts.window_ms, do: at
    step = step(Enum.at(opts.pauses_ms, length(recent)), length(recent) + 1)
    {%{policy | ends: Map.put(policy.ends, app, [now_ms | recent])}, step}
  end

  defp step(nil, _n), do: :give_up
  defp step(pause_ms, n), do: {:start, n, pause_ms}

  @doc """
  What is done then: on a board that was restarted so often before, and whose firmware is on trial
  or not.

      iex> alias BB.Firmware.Applications.RestartPolicy
      iex> policy = RestartPolicy.new(board_restarts: 2)
      iex> for n <- [0, 1, 2, :unknown], do: RestartPolicy.last_step(policy, n, false)
      [:restart_board, :restart_board, {:stay, 60_000}, {:stay, 60_000}]
      iex> RestartPolicy.last_step(policy, 2, true)
      :revert
  """
  @spec last_step(t(), board_restarts :: non_neg_integer() | :unknown, on_trial? :: boolean()) ::
          last_step()
  def last_step(_decision, _restarts, true), do: :revert

  def last_step(%{opts: opts}, restarts, false) do
    if is_integer(restarts) and restarts < opts.board_restarts,
      do: :restart_board,
      else: {:stay, opts.stay_ms}
  end

  @doc "How long a start waits once nothing helps."
  @spec stay_ms(t()) :: pos_integer()
  def stay_ms(policy), do: policy.opts.stay_ms

  @doc "How long everything has to run to count as success."
  @spec calm_ms(t()) :: pos_integer()
  def calm_ms(policy), do: policy.opts.calm_ms
end

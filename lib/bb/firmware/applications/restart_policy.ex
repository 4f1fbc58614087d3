defmodule BB.Firmware.Applications.RestartPolicy do
  @moduledoc """
  Decides what follows when an application ends: a start of the application, or a restart of the
  board. Pure; the clock is an argument, in milliseconds. `BB.Firmware.Applications.Restarter`
  uses it.

  An application that ends is started again, at once the first time and then after longer
  pauses, as often as `pauses_ms` has pauses, within `window_ms`. When it ends once more, the
  board is restarted.

  The board is restarted at most `board_restarts` times, because a board that restarts for ever
  accepts no update. After that the board stays up without the application, which is started again
  every `stay_ms`. The board also stays up when the number of its restarts is unknown. `calm_ms`
  without an end count as success, and the counts begin at zero.

  Firmware on trial is reverted instead of restarted.

      iex> alias BB.Firmware.Applications.RestartPolicy
      iex> policy = RestartPolicy.new([])
      iex> {policy, {:start, 1, 0}} = RestartPolicy.handle_end(policy, :robot, :killed, 0)
      iex> {_policy, {:start, 2, 1_000}} = RestartPolicy.handle_end(policy, :robot, :killed, 400)

  An application that a person has stopped (reason `:stopped`) stays stopped.
  """

  @schema BB.Options.new!(
            pauses_ms: [
              type: {:list, :non_neg_integer},
              default: [0, 1_000, 5_000, 15_000],
              doc: "The pauses before the starts, in milliseconds."
            ],
            window_ms: [
              type: :pos_integer,
              default: 300_000,
              doc: "The time within which ends are counted, in milliseconds."
            ],
            board_restarts: [
              type: :non_neg_integer,
              default: 3,
              doc: "The greatest number of restarts of the board."
            ],
            stay_ms: [
              type: :pos_integer,
              default: 60_000,
              doc: "The pause before a start once the board stays up."
            ],
            calm_ms: [
              type: :pos_integer,
              default: 600_000,
              doc: "The time without an end that counts as success."
            ]
          )

  @enforce_keys [:opts]
  defstruct [:opts, ends: %{}]

  @type t :: %__MODULE__{}

  @typedoc """
  The n-th start, after a pause; no more start, because starts do not help; or nothing.
  """
  @type step :: {:start, n :: pos_integer(), pause_ms :: non_neg_integer()} | :give_up | :nothing

  @typedoc "The last step, when starts do not help."
  @type last_step :: :revert | :restart_board | {:stay, pause_ms :: pos_integer()}

  @doc """
  Makes a policy.

  ## Options

  #{BB.Options.docs(@schema)}
  """
  @spec new(keyword()) :: t()
  def new(opts), do: %__MODULE__{opts: Map.new(BB.Options.validate!(opts, @schema))}

  @doc "Returns the greatest number of starts of an application."
  @spec starts(t()) :: non_neg_integer()
  def starts(policy), do: length(policy.opts.pauses_ms)

  @doc "Handles the end, or the failed start, of an application."
  @spec handle_end(t(), atom(), reason :: term(), integer()) :: {t(), step()}
  def handle_end(policy, app, :stopped, _now_ms),
    do: {%{policy | ends: Map.delete(policy.ends, app)}, :nothing}

  def handle_end(%{opts: opts} = policy, app, _reason, now_ms) do
    recent = for at <- Map.get(policy.ends, app, []), now_ms - at < opts.window_ms, do: at
    step = step(Enum.at(opts.pauses_ms, length(recent)), length(recent) + 1)
    {%{policy | ends: Map.put(policy.ends, app, [now_ms | recent])}, step}
  end

  defp step(nil, _n), do: :give_up
  defp step(pause_ms, n), do: {:start, n, pause_ms}

  @doc """
  Decides the last step, from the number of the board's restarts, and whether its firmware is on
  trial.

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

  @doc "Returns the pause before a start once the board stays up."
  @spec stay_ms(t()) :: pos_integer()
  def stay_ms(policy), do: policy.opts.stay_ms

  @doc "Returns the time without an end that counts as success."
  @spec calm_ms(t()) :: pos_integer()
  def calm_ms(policy), do: policy.opts.calm_ms
end

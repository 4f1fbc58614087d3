defmodule BB.Safety.Table do
  @moduledoc """
  Where safety is kept: two ETS tables, so that whoever asks waits for nobody and a process that dies takes nothing with it.

  They belong to the process that calls `create/0`: the application's own, which lives as long as the application and runs
  none of our code after its start.

    * `BB.Safety.Records` - `{robot, state, epoch, record}`, written by the robot's warden only
    * `BB.Safety.Entries` - `{{:handler, robot, path}, owner, module, opts, id}`, `{{:inhibition, robot, path}, reason, voucher}` and
      `{{:run, robot, round, n}, holder, outcome, handler}`
  """

  alias BB.Safety.Record

  @records BB.Safety.Records
  @entries BB.Safety.Entries

  @typedoc "A registered `disarm/1`: the process that registered it, its module and options. The id is that of the registration."
  @type handler ::
          {{:handler, module(), [atom()]}, owner :: pid(), module(), opts :: keyword(),
           id :: integer()}

  @typedoc "A handler's turn in a round. Its holder is the process that runs it."
  @type run ::
          {run_key(), holder :: pid() | :nobody, outcome :: nil | :ok | {:error, term()},
           handler()}
  @type run_key :: {:run, module(), round :: integer(), non_neg_integer()}

  @doc "Makes the tables, unless they are there."
  @spec create() :: :ok
  def create do
    unless running?() do
      @records = :ets.new(@records, [:named_table, :public, read_concurrency: true])
      @entries = :ets.new(@entries, [:named_table, :public, :ordered_set])
    end

    :ok
  end

  @doc "Whether the tables are there."
  @spec running?() :: boolean()
  def running?, do: :ets.whereis(@entries) != :undefined

  # Records

  @doc "A robot's state; `:disarmed` when nothing is known of it."
  @spec state(module()) :: Record.state()
  def state(robot) do
    :ets.lookup_element(@records, robot, 2)
  rescue
    ArgumentError -> :disarmed
  end

  @doc "The number of its latest arming."
  @spec epoch(module()) :: {:ok, non_neg_integer()} | :error
  def epoch(robot) do
    {:ok, :ets.lookup_element(@records, robot, 3)}
  rescue
    ArgumentError -> :error
  end

  @doc "Whether it has a record."
  @spec known?(module()) :: boolean()
  def known?(robot), do: running?() and :ets.member(@records, robot)

  @doc "The records of all robots."
  @spec records() :: [Record.t()]
  def records, do: :ets.select(@records, [{{:_, :_, :_, :"$1"}, [], [:"$1"]}])

  @doc "A robot's record."
  @spec record(module()) :: Record.t() | nil
  def record(robot) do
    case :ets.lookup(@records, robot) do
      [{_robot, _state, _epoch, record}] -> record
      [] -> nil
    end
  end

  @doc "Keeps a record."
  @spec put(Record.t()) :: true
  def put(record), do: :ets.insert(@records, {record.robot, record.state, record.epoch, record})

  @doc "Forgets a robot: its record, then its handlers. What inhibits arming stays."
  @spec forget(module()) :: :ok
  def forget(robot) do
    :ets.delete(@records, robot)
    for handler <- handlers(robot), do: :ets.delete_object(@entries, handler)
    :ok
  end

  # Handlers

  @doc "Registers a handler in the place of the one that has its path."
  @spec register(module(), [atom()], pid(), module(), keyword()) :: true
  def register(robot, path, owner, module, opts) do
    id = System.unique_integer()
    :ets.insert(@entries, {{:handler, robot, path}, owner, module, opts, id})
  end

  @doc "The robot's handlers."
  @spec handlers(module()) :: [handler()]
  def handlers(robot), do: :ets.match_object(@entries, {{:handler, robot, :_}, :_, :_, :_, :_})

  @doc "Removes a handler if its process has ended and no other has registered for its path since."
  @spec release(handler()) :: :ok
  def release({_key, owner, _module, _opts, _id} = handler) do
    unless Process.alive?(owner), do: :ets.delete_object(@entries, handler)
    :ok
  end

  # Inhibitions

  @doc "Keeps what inhibits arming, for a path."
  @spec inhibit(module(), [atom()], term()) :: true
  def inhibit(robot, path, reason),
    do: :ets.insert(@entries, {{:inhibition, robot, path}, reason, :nobody})

  @doc "Keeps that a path inhibits nothing while a process lives, and from its end on does."
  @spec vouch(module(), [atom()], pid()) :: true
  def vouch(robot, path, pid),
    do: :ets.insert(@entries, {{:inhibition, robot, path}, :unattended, pid})

  @doc "The processes that vouch for paths."
  @spec vouchers(module()) :: [{[atom()], pid()}]
  def vouchers(robot) do
    for {{_, _, path}, _reason, pid} when is_pid(pid) <- inhibition_rows(robot), do: {path, pid}
  end

  @doc "Removes it."
  @spec allow(module(), [atom()]) :: true
  def allow(robot, path), do: :ets.delete(@entries, {:inhibition, robot, path})

  @doc "What inhibits arming, by path."
  @spec inhibitions(module()) :: [{[atom()], term()}]
  def inhibitions(robot) do
    for {{_, _, path}, reason, voucher} <- inhibition_rows(robot),
        voucher == :nobody or not Process.alive?(voucher),
        do: {path, reason}
  end

  @doc "Whether anything is kept for a path: that it inhibits arming, or that a process vouches for it."
  @spec watched?(module(), [atom()]) :: boolean()
  def watched?(robot, path), do: :ets.member(@entries, {:inhibition, robot, path})

  defp inhibition_rows(robot),
    do: :ets.match_object(@entries, {{:inhibition, robot, :_}, :_, :_})

  # Runs

  @doc "Gives each handler its turn in a round."
  @spec prepare(module(), integer(), [handler()]) :: true
  def prepare(robot, round, handlers) do
    runs =
      for {handler, n} <- Enum.with_index(handlers),
          do: {{:run, robot, round, n}, :nobody, nil, handler}

    :ets.insert(@entries, runs)
  end

  @doc "Makes the calling process the holder, which only one process becomes."
  @spec claim(run_key()) :: boolean()
  def claim(key) do
    head = {key, :nobody, nil, :"$1"}
    held = {{{:const, key}, {:const, self()}, nil, :"$1"}}
    :ets.select_replace(@entries, [{head, [], [held]}]) == 1
  end

  @doc "Keeps the outcome of a run. Of a round that is over nothing is kept."
  @spec settle(run_key(), :ok | {:error, term()}) :: boolean()
  def settle(key, outcome), do: :ets.update_element(@entries, key, {3, outcome})

  @doc "A run."
  @spec run(run_key()) :: run()
  def run(key), do: @entries |> :ets.lookup(key) |> hd()

  @doc "The runs of a round, or of all rounds (`:_`)."
  @spec runs(module(), integer() | :_) :: [run()]
  def runs(robot, round),
    do: :ets.match_object(@entries, {{:run, robot, round, :_}, :_, :_, :_})

  @doc "Clears the robot's runs but those of a round."
  @spec clear_runs(module(), integer() | nil) :: :ok
  def clear_runs(robot, but) do
    for {{:run, _, round, _} = key, _, _, _} <- runs(robot, :_),
        round != but,
        do: :ets.delete(@entries, key)

    :ok
  end
end

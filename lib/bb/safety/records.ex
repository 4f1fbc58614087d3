defmodule BB.Safety.Records do
  @moduledoc """
  The safety records of all robots, in two ETS tables. A reader waits for no process, and a
  process that dies loses nothing.

  The tables last as long as the VM: when the process that made them ends, the application
  controller inherits them, which ends with the VM. So no application, supervisor or warden takes
  them with it.

    * `BB.Safety.Records` - `{robot, state, epoch, record}`, which only the robot's warden writes
    * `BB.Safety.Entries` - rows that other processes write too:
        * `{{:handler, robot, path}, owner, module, opts, id}`
        * `{{:inhibition, robot, path}, reason, voucher}`
        * `{{:run, robot, round, n}, holder, outcome, handler}`
        * `{:host, pid}`
  """
  @moduledoc no_example: "internal: BB.Safety is its interface"

  alias BB.Safety.Record

  @records BB.Safety.Records
  @entries BB.Safety.Entries

  @typedoc """
  A registered `disarm/1`: the process that registered it, its module and options, and the id of
  the registration.
  """
  @type handler ::
          {{:handler, module(), [atom()]}, owner :: pid(), module(), opts :: keyword(),
           id :: integer()}

  @typedoc "The run of a handler in a round. Its holder is the process that calls the handler."
  @type run ::
          {run_key(), holder :: pid() | :nobody, outcome :: nil | :ok | {:error, term()},
           handler()}
  @type run_key :: {:run, module(), round :: integer(), non_neg_integer()}

  @doc "Creates the tables, unless they exist. One process at a time may call it."
  @spec create() :: :ok
  def create do
    create(@records, [:set, read_concurrency: true])
    create(@entries, [:ordered_set])
  end

  defp create(name, options) do
    heir = {:heir, Process.whereis(:application_controller), __MODULE__}

    _ =
      if :ets.whereis(name) == :undefined,
        do: :ets.new(name, [:named_table, :public, heir | options])

    :ok
  end

  @doc "Returns whether the tables exist: safety was started in this VM."
  @spec running?() :: boolean()
  def running?, do: :ets.whereis(@entries) != :undefined

  # The host

  @doc "Stores the host."
  @spec put_host(pid()) :: true
  def put_host(pid), do: :ets.insert(@entries, {:host, pid})

  @doc "Removes the host, if it is the process `pid`."
  @spec remove_host(pid()) :: true
  def remove_host(pid), do: :ets.delete_object(@entries, {:host, pid})

  @doc "Returns the host, dead or alive."
  @spec host() :: pid() | nil
  def host do
    case :ets.lookup(@entries, :host) do
      [{:host, pid}] -> pid
      [] -> nil
    end
  end

  @doc "Returns whether the host is alive."
  @spec hosted?() :: boolean()
  def hosted? do
    pid = host()
    is_pid(pid) and Process.alive?(pid)
  end

  # Records

  @doc "Returns a robot's state: `:disarmed` for an unknown robot."
  @spec state(module()) :: Record.state()
  def state(robot) do
    :ets.lookup_element(@records, robot, 2)
  rescue
    ArgumentError -> :disarmed
  end

  @doc "Returns the number of a robot's arming while it is armed."
  @spec epoch(module()) :: {:ok, pos_integer()} | :error
  def epoch(robot) do
    case :ets.lookup(@records, robot) do
      [{_robot, :armed, epoch, _record}] -> {:ok, epoch}
      _not_armed -> :error
    end
  rescue
    ArgumentError -> :error
  end

  @doc "Returns the number of a robot's latest arming, 0 before the first."
  @spec latest_epoch(module()) :: {:ok, non_neg_integer()} | :error
  def latest_epoch(robot) do
    {:ok, :ets.lookup_element(@records, robot, 3)}
  rescue
    ArgumentError -> :error
  end

  @doc "Returns whether a robot has a record."
  @spec known?(module()) :: boolean()
  def known?(robot), do: running?() and :ets.member(@records, robot)

  @doc "Returns the records of all robots."
  @spec records() :: [Record.t()]
  def records, do: :ets.select(@records, [{{:_, :_, :_, :"$1"}, [], [:"$1"]}])

  @doc "Returns a robot's record, or `nil`."
  @spec record(module()) :: Record.t() | nil
  def record(robot) do
    case :ets.lookup(@records, robot) do
      [{_robot, _state, _epoch, record}] -> record
      [] -> nil
    end
  end

  @doc "Stores a record."
  @spec put(Record.t()) :: true
  def put(record), do: :ets.insert(@records, {record.robot, record.state, record.epoch, record})

  @doc """
  Deletes a robot's record, then the handlers of processes that have ended.

  Handlers of living processes, which are outside of the robot's tree, stay, and so do
  inhibitions.
  """
  @spec delete(module()) :: :ok
  def delete(robot) do
    :ets.delete(@records, robot)
    sweep(robot)
  end

  # Handlers

  @doc "Registers a handler. It replaces the handler of the same path."
  @spec register(module(), [atom()], pid(), module(), keyword()) :: true
  def register(robot, path, owner, module, opts) do
    id = System.unique_integer()
    :ets.insert(@entries, {{:handler, robot, path}, owner, module, opts, id})
  end

  @doc "Returns the robot's handlers."
  @spec handlers(module()) :: [handler()]
  def handlers(robot), do: :ets.match_object(@entries, {{:handler, robot, :_}, :_, :_, :_, :_})

  @doc """
  Removes a handler if its process has ended and no other handler was registered for its path
  since.
  """
  @spec release(handler()) :: :ok
  def release({_key, owner, _module, _opts, _id} = handler) do
    unless Process.alive?(owner), do: :ets.delete_object(@entries, handler)
    :ok
  end

  @doc "Releases all handlers of a robot."
  @spec sweep(module()) :: :ok
  def sweep(robot), do: Enum.each(handlers(robot), &release/1)

  # Inhibitions: `{:because, reason}` or `:none`, and the process that vouches for the path or
  # `:nobody`.

  @doc "Stores the reason for which a path inhibits arming. A voucher of the path stays."
  @spec inhibit(module(), [atom()], term()) :: true
  def inhibit(robot, path, reason) do
    key = {:inhibition, robot, path}
    because = {:because, reason}

    :ets.update_element(@entries, key, {2, because}) or
      :ets.insert_new(@entries, {key, because, :nobody}) or inhibit(robot, path, reason)
  end

  @doc "Stores that a path inhibits arming from the end of a process on, and not before."
  @spec vouch(module(), [atom()], pid()) :: true
  def vouch(robot, path, pid),
    do: :ets.insert(@entries, {{:inhibition, robot, path}, :none, pid})

  @doc "Returns the vouchers by path, dead ones too until `put_unattended/3`."
  @spec vouchers(module()) :: [{[atom()], pid()}]
  def vouchers(robot) do
    for {{_, _, path}, _reason, pid} when is_pid(pid) <- inhibition_rows(robot), do: {path, pid}
  end

  @doc "Returns whether a process is still the voucher of a path."
  @spec voucher?(module(), [atom()], pid()) :: boolean()
  def voucher?(robot, path, pid), do: {path, pid} in vouchers(robot)

  @doc "Stores the end of the voucher of a path. The row of a successor stays."
  @spec put_unattended(module(), [atom()], pid()) :: non_neg_integer()
  def put_unattended(robot, path, pid) do
    key = {:inhibition, robot, path}
    row = fn reason, voucher -> {{{:const, key}, reason, voucher}} end

    :ets.select_replace(@entries, [
      {{key, :none, pid}, [], [row.({:const, {:because, :unattended}}, :nobody)]},
      {{key, :"$1", pid}, [], [row.(:"$1", :nobody)]}
    ])
  end

  @doc "Removes the inhibition of a path."
  @spec allow(module(), [atom()]) :: true
  def allow(robot, path), do: :ets.delete(@entries, {:inhibition, robot, path})

  @doc "Returns the inhibitions, by path."
  @spec inhibitions(module()) :: [{[atom()], term()}]
  def inhibitions(robot) do
    for {{_, _, path}, inhibition, voucher} <- inhibition_rows(robot),
        {:because, reason} <- [effective_inhibition(inhibition, voucher)],
        do: {path, reason}
  end

  defp effective_inhibition(:none, voucher) when is_pid(voucher),
    do: if(Process.alive?(voucher), do: :none, else: {:because, :unattended})

  defp effective_inhibition(inhibition, _voucher), do: inhibition

  defp inhibition_rows(robot),
    do: :ets.match_object(@entries, {{:inhibition, robot, :_}, :_, :_})

  # Runs

  @doc "Creates the runs of a round, one for each handler."
  @spec create_runs(module(), integer(), [handler()]) :: true
  def create_runs(robot, round, handlers) do
    runs =
      for {handler, n} <- Enum.with_index(handlers),
          do: {{:run, robot, round, n}, :nobody, nil, handler}

    :ets.insert(@entries, runs)
  end

  @doc "Claims a run for the calling process. Returns `true` to one process only."
  @spec claim(run_key()) :: boolean()
  def claim(key) do
    head = {key, :nobody, nil, :"$1"}
    held = {{{:const, key}, {:const, self()}, nil, :"$1"}}
    :ets.select_replace(@entries, [{head, [], [held]}]) == 1
  end

  @doc "Stores the outcome of a run, unless its round is over."
  @spec put_outcome(run_key(), :ok | {:error, term()}) :: boolean()
  def put_outcome(key, outcome), do: :ets.update_element(@entries, key, {3, outcome})

  @doc "Returns a run."
  @spec run(run_key()) :: run()
  def run(key), do: @entries |> :ets.lookup(key) |> hd()

  @doc "Returns the runs of a round, or of all rounds (`:_`)."
  @spec runs(module(), integer() | :_) :: [run()]
  def runs(robot, round),
    do: :ets.match_object(@entries, {{:run, robot, round, :_}, :_, :_, :_})

  @doc "Deletes the robot's runs, except the runs of a round."
  @spec clear_runs(module(), integer() | nil) :: :ok
  def clear_runs(robot, except) do
    for {{:run, _, round, _} = key, _, _, _} <- runs(robot, :_),
        round != except,
        do: :ets.delete(@entries, key)

    :ok
  end
end

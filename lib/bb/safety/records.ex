defmodule BB.Safety.Records do
  @moduledoc """
  Where safety is kept: two ETS tables, so that whoever asks waits for nobody and a process that
  dies takes nothing with it.

  They last as long as the VM: when the process that made them ends, they go to the application
  controller, which ends with the VM alone. So nothing is lost with any application, supervisor or
  warden.

    * `BB.Safety.Records` - `{robot, state, epoch, record}`, written by the robot's warden only
    * `BB.Safety.Entries` - what others write too:
        * `{{:handler, robot, path}, owner, module, opts, id}`
        * `{{:inhibition, robot, path}, reason, voucher}`
        * `{{:run, robot, round, n}, holder, outcome, handler}`
        * `{:host, pid}`
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

  @doc "Makes the tables, unless they are there. To be called by one process at a time."
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

  @doc "Whether the tables are there: safety was started in this VM."
  @spec running?() :: boolean()
  def running?, do: :ets.whereis(@entries) != :undefined

  # The host

  @doc "Keeps the process of the application that safety serves."
  @spec put_host(pid()) :: true
  def put_host(pid), do: :ets.insert(@entries, {:host, pid})

  @doc "Removes the host, if it is that process."
  @spec remove_host(pid()) :: true
  def remove_host(pid), do: :ets.delete_object(@entries, {:host, pid})

  @doc "The host, dead or alive."
  @spec host() :: pid() | nil
  def host do
    case :ets.lookup(@entries, :host) do
      [{:host, pid}] -> pid
      [] -> nil
    end
  end

  @doc "Whether there is a living host."
  @spec hosted?() :: boolean()
  def hosted? do
    pid = host()
    is_pid(pid) and Process.alive?(pid)
  end

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

  @doc """
  Forgets a robot: its record, then the handlers whose processes have ended. Those of living
  processes stay, which are outside of the robot's tree, and so does what inhibits arming.
  """
  @spec forget(module()) :: :ok
  def forget(robot) do
    :ets.delete(@records, robot)
    sweep(robot)
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

  @doc "Releases all handlers of a robot."
  @spec sweep(module()) :: :ok
  def sweep(robot), do: Enum.each(handlers(robot), &release/1)

  # Inhibitions: `{:because, reason}` or `:none`, and the process that vouches for the path, or
  # `:nobody`.

  @doc "Keeps what inhibits arming, for a path. Who vouches for it does so still."
  @spec inhibit(module(), [atom()], term()) :: true
  def inhibit(robot, path, reason) do
    key = {:inhibition, robot, path}
    because = {:because, reason}

    :ets.update_element(@entries, key, {2, because}) or
      :ets.insert_new(@entries, {key, because, :nobody}) or inhibit(robot, path, reason)
  end

  @doc "Keeps that a path inhibits nothing while a process lives, and from its end on does."
  @spec vouch(module(), [atom()], pid()) :: true
  def vouch(robot, path, pid),
    do: :ets.insert(@entries, {{:inhibition, robot, path}, :none, pid})

  @doc "The processes that vouch for paths, dead ones too until `unattended/3`."
  @spec vouchers(module()) :: [{[atom()], pid()}]
  def vouchers(robot) do
    for {{_, _, path}, _reason, pid} when is_pid(pid) <- inhibition_rows(robot), do: {path, pid}
  end

  @doc "Whether that process vouches for a path still: nobody vouches in its place."
  @spec voucher?(module(), [atom()], pid()) :: boolean()
  def voucher?(robot, path, pid), do: {path, pid} in vouchers(robot)

  @doc "Keeps that the process that vouched for a path has ended. A successor's row stays."
  @spec unattended(module(), [atom()], pid()) :: non_neg_integer()
  def unattended(robot, path, pid) do
    key = {:inhibition, robot, path}
    row = fn reason, voucher -> {{{:const, key}, reason, voucher}} end

    :ets.select_replace(@entries, [
      {{key, :none, pid}, [], [row.({:const, {:because, :unattended}}, :nobody)]},
      {{key, :"$1", pid}, [], [row.(:"$1", :nobody)]}
    ])
  end

  @doc "Removes it."
  @spec allow(module(), [atom()]) :: true
  def allow(robot, path), do: :ets.delete(@entries, {:inhibition, robot, path})

  @doc "What inhibits arming, by path."
  @spec inhibitions(module()) :: [{[atom()], term()}]
  def inhibitions(robot) do
    for {{_, _, path}, inhibition, voucher} <- inhibition_rows(robot),
        {:because, reason} <- [because(inhibition, voucher)],
        do: {path, reason}
  end

  defp because(:none, voucher) when is_pid(voucher),
    do: if(Process.alive?(voucher), do: :none, else: {:because, :unattended})

  defp because(inhibition, _voucher), do: inhibition

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

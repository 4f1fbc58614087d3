defmodule BB.Parameter.PersistenceTest do
  @moduledoc "Stores of others do what they like, to nobody but themselves."

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Parameter
  alias BB.Parameter.Changed
  alias BB.Test.FlakyStore

  @moduletag timeout: 300_000

  defmodule ManyStore do
    @moduledoc "A `BB.Test.FlakyStore` that takes several values as one."
    @behaviour BB.Parameter.Store

    @impl BB.Parameter.Store
    defdelegate init(robot, opts), to: FlakyStore
    @impl BB.Parameter.Store
    defdelegate load(robot), to: FlakyStore
    @impl BB.Parameter.Store
    defdelegate save(robot, path, value), to: FlakyStore
    @impl BB.Parameter.Store
    defdelegate close(robot), to: FlakyStore

    @impl BB.Parameter.Store
    def damage(robot), do: FlakyStore.run(robot, :damage, fn -> nil end)

    @impl BB.Parameter.Store
    def save_many(robot, values) do
      FlakyStore.run(robot, :save_many, fn ->
        if FlakyStore.script_of(robot, :refuses, fn _values -> false end).(values),
          do: {:error, :enospc},
          else: put(robot, values)
      end)
    end

    defp put(robot, values) do
      for {path, value} <- values, do: FlakyStore.put(robot, path, value)
      :ok
    end
  end

  defp tunable(store) do
    params = for n <- 1..50, do: quote(do: param(unquote(:"p#{n}"), type: :integer, default: 0))

    create(
      quote do
        settings parameter_store: unquote(store)
        parameters(do: unquote({:__block__, [], params}))
      end
    )
  end

  defp alarm(robot, which) do
    for {{Parameter, ^robot, ^which}, about} <- :alarm_handler.get_alarms(), do: about
  end

  defp failure(:raises), do: fn -> raise "broken" end
  defp failure(:throws), do: fn -> throw(:broken) end
  defp failure(:exits), do: fn -> exit(:broken) end
  defp failure(:is_killed), do: fn -> Process.exit(self(), :kill) end
  defp failure(:returns_an_error), do: fn -> {:error, :enospc} end
  defp failure(:returns_nonsense), do: fn -> {:ok, [17], :or_so} end
  defp failure(:never_returns), do: fn -> Process.sleep(:infinity) end
  defp failure(:loops), do: fn -> Enum.each(Stream.cycle([1]), & &1) end

  @failures ~w(raises throws exits is_killed returns_an_error returns_nonsense never_returns)a

  @stores [
    {FlakyStore, :init},
    {FlakyStore, :load},
    {FlakyStore, :save},
    {ManyStore, :save_many},
    {FlakyStore, :close},
    {ManyStore, :damage}
  ]

  # One that loops takes a processor as long as it is let.
  @cases for({store, callback} <- @stores, how <- @failures, do: {store, callback, how}) ++
           [{FlakyStore, :save, :loops}]

  test "whatever a callback does hurts only its store, which is used again when it works" do
    @cases
    |> Task.async_stream(&{&1, outcome(&1)}, max_concurrency: 16, timeout: :infinity)
    |> Enum.each(fn {:ok, {what, outcome}} -> assert {what, outcome} == {what, :as_expected} end)
  end

  # All at once, since some take their time.
  defp outcome({store, callback, failure}) do
    robot = tunable(store)
    FlakyStore.put(robot, [:p9], 9)
    FlakyStore.script(robot, [{callback, failure(failure)}])
    {:ok, supervisor} = robot.start_link()
    {:ok, _} = BB.subscribe(robot, [:param])
    check(callback, failure, robot, store)
    assert Process.whereis(robot) == supervisor
    assert Supervisor.stop(robot) == :ok
    assert alarm(robot, :not_kept) == []
    :as_expected
  rescue
    error in ExUnit.AssertionError -> Exception.message(error)
  end

  defp check(callback, _failure, robot, _store) when callback in [:close, :damage] do
    assert eventually(fn -> Parameter.set(robot, [:p1], 1) == :ok end, 60_000)
    assert FlakyStore.all(robot) == %{[:p1] => 1, [:p9] => 9}
  end

  defp check(callback, failure, robot, store) do
    assert {:error, {:not_kept, reason}} = Parameter.set(robot, [:p1], 1)
    assert {:error, {:not_kept, _}} = Parameter.set_many(robot, [{[:p2], 2}, {[:p3], 3}])
    assert reason == expected(failure)
    assert {Parameter.get(robot, [:p1]), Parameter.get(robot, [:p3])} == {{:ok, 1}, {:ok, 3}}
    assert_received {:bb, [:param, :p1], %{payload: %Changed{old_value: 0, new_value: 1}}}
    assert [%{store: ^store, reason: _, description: words}] = alarm(robot, :not_kept)
    assert words == BB.Parameter.Reason.format(reason)

    FlakyStore.reset(robot, callback)
    assert eventually(fn -> alarm(robot, :not_kept) == [] end, 60_000)
    assert FlakyStore.all(robot) == %{[:p1] => 1, [:p2] => 2, [:p3] => 3, [:p9] => 9}
    assert Parameter.set(robot, [:p1], 4) == :ok
    assert FlakyStore.all(robot)[[:p1]] == 4
  end

  defp expected(:raises), do: %RuntimeError{message: "broken"}
  defp expected(:throws), do: {:thrown, :broken}
  defp expected(:exits), do: {:exit, :broken}
  defp expected(:is_killed), do: {:exit, :killed}
  defp expected(:returns_an_error), do: :enospc
  defp expected(:returns_nonsense), do: {:bad_return_value, {:ok, [17], :or_so}}
  defp expected(never) when never in [:never_returns, :loops], do: {:timeout, 5_000}

  test "a store that cannot be closed is told by the log" do
    robot = tunable(FlakyStore)
    start_supervised!(robot)
    FlakyStore.script(robot, close: failure(:returns_an_error))
    log = capture_log(fn -> stop_supervised!(robot) end)
    said = "#{inspect(robot)}: cannot close the parameter store BB.Test.FlakyStore: "
    assert log =~ said <> "no space left on device (enospc)"
  end

  test "a store whose own process ends is opened anew" do
    robot = tunable(FlakyStore)
    test = self()

    FlakyStore.script(robot,
      init: fn ->
        send(test, {:opened, spawn_link(fn -> Process.sleep(:infinity) end)})
        {:ok, robot}
      end
    )

    start_supervised!(robot)
    assert_received {:opened, part}
    capture_log(fn -> Process.exit(part, :boom) end)
    assert_receive {:opened, _another}, 30_000
    assert eventually(fn -> Parameter.set(robot, [:p1], 1) == :ok end, 60_000)
    assert alarm(robot, :not_kept) == []
  end

  test "what it is told is said once in the log while it lasts, and when it is over" do
    robot = tunable(ManyStore)
    start_supervised!(robot)
    FlakyStore.script(robot, save_many: failure(:returns_an_error))

    log =
      capture_log(fn ->
        for n <- 1..20, do: {:error, _} = Parameter.set(robot, [:p1], n)
        FlakyStore.reset(robot, :save_many)
        assert Parameter.set(robot, [:p2], 1) == :ok
      end)

    said =
      "cannot save [:p1] in the parameter store #{inspect(ManyStore)}: no space left on device"

    assert length(String.split(log, said)) == 2
    assert log =~ "the parameter store #{inspect(ManyStore)} saves values again"
  end

  test "what a store finds damaged sets an alarm, until the robot is stopped" do
    robot = tunable(ManyStore)
    damage = %{file: "f", kept_as: "f.corrupt", lost: 3}
    FlakyStore.script(robot, damage: fn -> damage end)
    start_supervised!(robot)
    assert alarm(robot, :damaged) == [damage]
    stop_supervised!(robot)
    assert alarm(robot, :damaged) == []
  end

  describe "many processes that set at once" do
    test "share calls of the store, and none is told what is not so" do
      robot = tunable(ManyStore)
      start_supervised!(robot)
      test = self()

      # The first call waits for the test.
      FlakyStore.script(robot,
        save_many: fn ->
          send(test, {:saving, self()})
          receive do: (:go -> {:error, :eio})
        end
      )

      setters = for n <- 1..50, do: Task.async(fn -> Parameter.set(robot, [:"p#{n}"], n) end)
      assert_receive {:saving, host}, 30_000
      all = for n <- 1..50, into: %{}, do: {[:"p#{n}"], n}
      assert eventually(fn -> Enum.all?(all, fn {p, n} -> Parameter.get!(robot, p) == n end) end)
      FlakyStore.reset(robot, :save_many)
      send(host, :go)
      answers = Task.await_many(setters, 60_000)
      assert Enum.all?(answers, &(&1 in [:ok, {:error, {:not_kept, :eio}}]))
      assert :ok in answers
      assert eventually(fn -> FlakyStore.all(robot) == all end, 60_000)
    end

    test "are not told of a time-out, however slow the store is" do
      robot = tunable(FlakyStore)
      start_supervised!(robot)

      # Longer than the five seconds that a call has by default, all together.
      FlakyStore.script(robot, save: fn -> Process.sleep(150) end)
      setters = for n <- 1..50, do: Task.async(fn -> Parameter.set(robot, [:"p#{n}"], n) end)
      assert Enum.all?(Task.await_many(setters, 120_000), &(&1 == :ok))
    end
  end

  test "a value that is too large for the store holds up no other" do
    robot = tunable(ManyStore)
    start_supervised!(robot)
    FlakyStore.script(robot, refuses: fn values -> {[:p1], 1} in values end)
    assert Parameter.set(robot, [:p1], 1) == {:error, {:not_kept, :enospc}}
    assert Parameter.set_many(robot, [{[:p2], 2}, {[:p3], 3}]) == :ok
    assert FlakyStore.all(robot) == %{[:p2] => 2, [:p3] => 3}
    assert [%{reason: :enospc}] = alarm(robot, :not_kept)
    assert Parameter.set(robot, [:p1], 7) == :ok
    assert FlakyStore.all(robot)[[:p1]] == 7
    assert alarm(robot, :not_kept) == []
  end

  test "values that a store did not take outlive a crash of all but the table" do
    robot = tunable(ManyStore)
    start_supervised!(robot)
    FlakyStore.script(robot, save_many: failure(:returns_an_error))
    assert {:error, {:not_kept, :enospc}} = Parameter.set(robot, [:p1], 1)
    persistence = Process.whereis(Module.concat(robot, ParameterPersistence))
    ref = Process.monitor(persistence)
    Process.exit(persistence, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}, 30_000
    FlakyStore.reset(robot, :save_many)
    assert eventually(fn -> FlakyStore.all(robot) == %{[:p1] => 1} end, 60_000)
    assert eventually(fn -> alarm(robot, :not_kept) == [] end, 60_000)
    assert Parameter.get!(robot, [:p1]) == 1
  end
end

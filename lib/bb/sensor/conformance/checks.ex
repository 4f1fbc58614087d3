defmodule BB.Sensor.Conformance.Checks do
  @moduledoc """
  What every driver does, each as a function that raises `BB.Sensor.Conformance.Failure` when one does not.
  """

  alias BB.Sensor.Conformance.{Bench, Failure, Setting}

  @second_ns 1_000_000_000
  @minute_s 60
  @tolerance 0.001
  @events 60

  @doc "With another device in its chip's place it is down, and says why; with its own it is up."
  @spec identity(Setting.t()) :: :ok
  def identity(setting) do
    Bench.on(setting, [device: setting.other_device], fn bench ->
      comes_up(bench, "another chip", fn ->
        :ok = setting.wires.exchange(bench.place, setting.device)
      end)
    end)
  end

  @doc "Without its device, or its bus, from the start on it is down, and says why; it is up when that is there."
  @spec absence(Setting.t()) :: :ok
  def absence(setting) do
    absence = setting.wires.absence()

    Bench.on(setting, [broken: absence], fn bench ->
      comes_up(bench, "an absent device", fn -> Bench.mend(bench, absence) end)
    end)
  end

  defp comes_up(bench, trouble, end_it) do
    row = Bench.await_down(bench, "refuses to work with #{trouble}")
    explained!(bench, row, trouble)
    tried_again(bench, row)
    none!(Bench.messages(bench), "with #{trouble} it published")
    _ = end_it.()
    _ = Bench.await_up(bench)
    _ = Bench.await_message(bench)
    :ok
  end

  @doc "Each fault is one status, one alarm and no message for as long as it lasts; then it is up and publishes anew."
  @spec faults(Setting.t()) :: :ok
  def faults(setting) do
    Bench.on(setting, fn bench ->
      for fault <- setting.faults do
        _ = Bench.await_up(bench)
        message = Bench.await_message(bench)
        check = if fault in setting.unseen, do: &survive/3, else: &report/3
        check.(bench, fault, message)
      end

      :ok
    end)
  end

  defp survive(bench, fault, message) do
    pid = Bench.pid!(bench)
    _ = Bench.break(bench, fault, message)
    _ = Bench.mend(bench, fault)
    _ = Bench.messages(bench)
    _ = Bench.await_message(bench)
    kept!(Bench.row(bench).pid == pid, "#{fault}, which it cannot see, ended its process")
  end

  defp report(bench, fault, message) do
    before = Bench.break(bench, fault, message)
    row = Bench.await_down(bench, "reports #{fault}")
    # What a line shows is what is there, until it turns out to be a fault.
    _ = if fault in bench.setting.wires.deceptive(), do: Bench.messages(bench)
    explained!(bench, row, fault)
    tried_again(bench, row)
    one!(Bench.await_statuses(bench, "reports #{fault}"), "reports of #{fault}")
    one!(Bench.await_alarms(bench, "has one alarm of #{fault}", 1), "alarms of #{fault}")
    during = Enum.reject(Bench.messages(bench), &(&1.monotonic_time in before))
    none!(during, "while there was #{fault} it published")

    mended_ns = Bench.mend(bench, fault)
    _ = Bench.await_up(bench)
    message = Bench.await_message(bench)

    kept!(
      message.monotonic_time >= mended_ns,
      "its first message after #{fault} was measured before that was over: #{inspect(message)}"
    )

    states = for status <- Bench.await_statuses(bench, "reports that it is up"), do: status.state

    kept!(
      states == [:up],
      "after #{fault} it was expected to be up, once, and was: #{inspect(states)}"
    )

    none!(Bench.await_alarms(bench, "has no alarm after #{fault}", 0), "alarms")
  end

  # One that is down is tried again; what is silent is left alone.
  defp tried_again(bench, %{state: :backoff, restarts: restarts}),
    do:
      Bench.await(
        bench,
        "is tried again",
        &(&1.restarts >= restarts + 2 and &1.state == :backoff)
      )

  defp tried_again(_bench, row), do: row

  @doc "With new options its process goes on, and its rate is the one that it declares for them."
  @spec options(Setting.t()) :: :ok
  def options(setting) do
    Bench.on(setting, [stepped?: true], fn bench ->
      _ = Bench.await_up(bench)
      _ = Bench.await_message(bench)
      pid = Bench.pid!(bench)
      Bench.change(bench, setting.new_options)
      row = Bench.await_up(bench)
      kept!(row.pid == pid, "new options ended its process: #{row.error}")
      kept!(length(Bench.statuses(bench)) <= 1, "new options took it down: #{row.error}")
      pace(bench, 10)
    end)
  end

  @doc "In a minute it publishes as often as it declares, or once for each event."
  @spec rate(Setting.t()) :: :ok
  def rate(setting) do
    Bench.on(setting, [stepped?: true], fn bench ->
      _ = Bench.await_up(bench)
      _ = Bench.await_message(bench)
      pace(bench, @minute_s)
    end)
  end

  defp pace(bench, seconds) do
    case Bench.row(bench).declared_hz do
      nil -> answer_events(bench, seconds)
      declared_hz -> keep_rate(bench, declared_hz, seconds)
    end
  end

  defp keep_rate(bench, declared_hz, seconds) do
    before = Bench.published(bench)
    Bench.pass(bench, seconds * @second_ns)
    count = Bench.published(bench) - before
    expected = declared_hz * seconds

    kept!(
      abs(count - expected) <= max(expected * @tolerance, 1),
      "it declares #{declared_hz} Hz and published #{count} messages in #{seconds} s"
    )
  end

  defp answer_events(bench, seconds) do
    kept!(
      bench.setting.event != nil,
      "it declares no rate: write rate/1, or give event: for a driver that waits for something to happen"
    )

    before = Bench.published(bench)

    for _ <- 1..@events do
      Bench.happen(bench)
      Bench.pass(bench, div(seconds * @second_ns, @events))
    end

    count = Bench.published(bench) - before
    kept!(count == @events, "of #{@events} events it published #{count}")
  end

  @doc "When it was killed it opens its bus again; when it was stopped nobody has it open."
  @spec release(Setting.t()) :: :ok
  def release(setting) do
    Bench.on(setting, fn bench ->
      _ = Bench.await_up(bench)
      pid = Bench.pid!(bench)
      Process.exit(pid, :kill)
      _ = Bench.await(bench, "is up after it was killed", &(&1.state == :up and &1.pid != pid))
      _ = Bench.await_message(bench)
      Supervisor.stop(bench.robot)
      wait_free(bench, 1_000)
    end)
  end

  # What it had open is given back in a process of its own.
  defp wait_free(bench, tries) do
    cond do
      bench.setting.wires.free?(bench.place) -> :ok
      tries == 0 -> raise Failure, "it has not given back its bus: #{inspect(bench.place)}"
      true -> wait_on(bench, tries - 1)
    end
  end

  defp wait_on(bench, tries) do
    Process.sleep(5)
    wait_free(bench, tries)
  end

  @doc "With its bus stuck it ends when it is told to, and need not be killed."
  @spec stop(Setting.t()) :: :ok
  def stop(setting) do
    Bench.on(setting, fn bench ->
      _ = Bench.await_up(bench)
      monitor = Process.monitor(Bench.pid!(bench))
      :ok = setting.wires.break(bench.place, setting.wires.stuck())
      Supervisor.stop(bench.robot)

      receive do
        {:DOWN, ^monitor, :process, _pid, reason} ->
          kept!(reason != :killed, "it did not end by itself, and was killed")
      end
    end)
  end

  # Judging

  defp explained!(bench, row, what) do
    words = row.error
    kept!(is_binary(words) and words != "", "it says nothing about #{what}")

    kept!(
      words != inspect(row.last_error),
      "for #{what} it has no words: add a clause to explain/1 of #{inspect(bench.setting.driver)} for #{words}"
    )
  end

  defp none!([], _what), do: :ok

  defp none!([first | _] = all, what),
    do: raise(Failure, "#{what} #{length(all)}, as #{inspect(first)}")

  defp one!([_one], _what), do: :ok

  defp one!(all, what),
    do: raise(Failure, "expected one of the #{what}, there are #{length(all)}: #{inspect(all)}")

  defp kept!(kept?, sentence), do: Failure.unless_kept(kept?, sentence)
end

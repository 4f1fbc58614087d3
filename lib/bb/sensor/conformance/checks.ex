defmodule BB.Sensor.Conformance.Checks do
  @moduledoc """
  The checks of a conformance test, one function for each.

  `BB.Sensor.Conformance.run/2` calls them. A check fails by `BB.Sensor.Conformance.Rig.fail!/1`.
  """
  @moduledoc no_example: "internal: `use BB.Sensor.Conformance` runs the checks"

  alias BB.Sensor.Conformance.{Rig, Setting}

  @second_ns 1_000_000_000
  @minute_s 60
  @tolerance 0.001
  @events 60

  @doc "Checks that the driver refuses another device, says why, and is up with its own."
  @spec identity(Setting.t()) :: :ok
  def identity(setting) do
    Rig.run(setting, [device: setting.other_device], fn rig ->
      check_recovery(rig, "another chip", fn ->
        :ok = setting.wires.exchange(rig.place, setting.device)
      end)
    end)
  end

  @doc "Checks that the driver is down without its device or bus, says why, and is up with it."
  @spec absence(Setting.t()) :: :ok
  def absence(setting) do
    absence = setting.wires.absence()

    Rig.run(setting, [broken: absence], fn rig ->
      check_recovery(rig, "an absent device", fn -> Rig.repair(rig, absence) end)
    end)
  end

  defp check_recovery(rig, trouble, remedy) do
    row = Rig.await_down(rig, "refuses to work with #{trouble}")
    explained!(rig, row, trouble)
    await_retry(rig, row)
    none!(Rig.messages(rig), "with #{trouble} it published")
    _ = remedy.()
    _ = Rig.await_up(rig)
    _ = Rig.await_message(rig)
    :ok
  end

  @doc """
  Checks that each fault causes one status, one alarm and no message while it lasts, and that the
  driver then is up and publishes new readings.
  """
  @spec faults(Setting.t()) :: :ok
  def faults(setting) do
    Rig.run(setting, fn rig ->
      for fault <- setting.faults do
        _ = Rig.await_up(rig)
        message = Rig.await_message(rig)

        check = if fault in setting.unseen, do: &check_survival/3, else: &check_fault/3
        check.(rig, fault, message)
      end

      :ok
    end)
  end

  defp check_survival(rig, fault, message) do
    pid = Rig.pid!(rig)
    _ = Rig.break(rig, fault, message)
    _ = Rig.repair(rig, fault)
    _ = Rig.messages(rig)
    _ = Rig.await_message(rig)
    check!(Rig.row(rig).pid == pid, "#{fault}, which the driver cannot detect, ended its process")
  end

  defp check_fault(rig, fault, message) do
    before = Rig.break(rig, fault, message)
    row = Rig.await_down(rig, "reports #{fault}")
    # A reading of a line counts until the level turns out to be a fault.
    _ = if fault in rig.setting.wires.deceptive(), do: Rig.messages(rig)
    explained!(rig, row, fault)
    await_retry(rig, row)
    one!(Rig.await_statuses(rig, "reports #{fault}"), "reports of #{fault}")
    one!(Rig.await_alarms(rig, "has one alarm of #{fault}", 1), "alarms of #{fault}")
    during = Enum.reject(Rig.messages(rig), &(&1.monotonic_time in before))
    none!(during, "while there was #{fault} it published")

    repaired_ns = Rig.repair(rig, fault)
    _ = Rig.await_up(rig)
    message = Rig.await_message(rig)

    check!(
      message.monotonic_time >= repaired_ns,
      "the first message after #{fault} was measured before its end: #{inspect(message)}"
    )

    states = for status <- Rig.await_statuses(rig, "reports that it is up"), do: status.state

    check!(
      states == [:up],
      "expected one status :up after #{fault}, got: #{inspect(states)}"
    )

    none!(Rig.await_alarms(rig, "has no alarm after #{fault}", 0), "alarms")
  end

  # A driver that is down is restarted. A silent one is not.
  defp await_retry(rig, %{state: :backoff, restarts: restarts}),
    do:
      Rig.await(
        rig,
        "is tried again",
        &(&1.restarts >= restarts + 2 and &1.state == :backoff)
      )

  defp await_retry(_rig, row), do: row

  @doc "Checks that new options keep the process, and that its rate is the one declared for them."
  @spec options(Setting.t()) :: :ok
  def options(setting) do
    Rig.run(setting, [stepped?: true], fn rig ->
      _ = Rig.await_up(rig)
      _ = Rig.await_message(rig)
      pid = Rig.pid!(rig)
      Rig.change_options(rig, setting.new_options)
      row = Rig.await_up(rig)
      check!(row.pid == pid, "new options ended its process: #{row.error}")
      check!(length(Rig.statuses(rig)) <= 1, "new options took it down: #{row.error}")
      check_rate(rig, 10)
    end)
  end

  @doc """
  Checks that in a minute the driver publishes at its declared rate, or once for each event.
  """
  @spec rate(Setting.t()) :: :ok
  def rate(setting) do
    Rig.run(setting, [stepped?: true], fn rig ->
      _ = Rig.await_up(rig)
      _ = Rig.await_message(rig)
      check_rate(rig, @minute_s)
    end)
  end

  defp check_rate(rig, seconds) do
    case Rig.row(rig).declared_hz do
      nil -> check_events(rig, seconds)
      declared_hz -> check_declared_rate(rig, declared_hz, seconds)
    end
  end

  defp check_declared_rate(rig, declared_hz, seconds) do
    before = Rig.published(rig)
    Rig.pass(rig, seconds * @second_ns)
    count = Rig.published(rig) - before
    expected = declared_hz * seconds

    check!(
      abs(count - expected) <= max(expected * @tolerance, 1),
      "the driver declares #{declared_hz} Hz and published #{count} messages in #{seconds} s"
    )
  end

  defp check_events(rig, seconds) do
    check!(
      rig.setting.event != nil,
      "the driver declares no rate: define rate/1, or set `event:` if it publishes events"
    )

    before = Rig.published(rig)

    for _ <- 1..@events do
      Rig.trigger_event(rig)
      Rig.pass(rig, div(seconds * @second_ns, @events))
    end

    count = Rig.published(rig) - before
    check!(count == @events, "expected #{@events} messages for #{@events} events, got: #{count}")
  end

  @doc "Checks that a killed driver opens its bus again, and that a stopped one has closed it."
  @spec release(Setting.t()) :: :ok
  def release(setting) do
    Rig.run(setting, fn rig ->
      _ = Rig.await_up(rig)
      pid = Rig.pid!(rig)
      Process.exit(pid, :kill)
      _ = Rig.await(rig, "is up after it was killed", &(&1.state == :up and &1.pid != pid))
      _ = Rig.await_message(rig)
      Supervisor.stop(rig.robot)
      await_free(rig, 1_000)
    end)
  end

  # Another process closes the bus of a killed one.
  defp await_free(rig, tries) do
    cond do
      rig.setting.wires.free?(rig.place) ->
        :ok

      tries == 0 ->
        Rig.fail!("the driver has not closed its bus: #{inspect(rig.place)}")

      true ->
        Process.sleep(5)
        await_free(rig, tries - 1)
    end
  end

  @doc "Checks that the driver stops in time while its bus is stuck, before it is killed."
  @spec stop(Setting.t()) :: :ok
  def stop(setting) do
    Rig.run(setting, fn rig ->
      _ = Rig.await_up(rig)
      monitor = Process.monitor(Rig.pid!(rig))
      :ok = setting.wires.break(rig.place, setting.wires.stuck())
      Supervisor.stop(rig.robot)

      receive do
        {:DOWN, ^monitor, :process, _pid, reason} ->
          check!(reason != :killed, "the driver did not end by itself, and was killed")
      end
    end)
  end

  # Assertions

  defp explained!(rig, row, trouble) do
    text = row.error
    check!(is_binary(text) and text != "", "the driver says nothing about #{trouble}")

    check!(
      text != inspect(row.last_error),
      "the driver does not explain #{trouble}: add a clause to explain/1 of " <>
        "#{inspect(rig.setting.driver)} for #{text}"
    )
  end

  defp none!([], _start), do: :ok

  defp none!([first | _] = all, start),
    do: Rig.fail!("#{start} #{length(all)}, such as #{inspect(first)}")

  defp one!([_one], _name), do: :ok

  defp one!(all, name),
    do: Rig.fail!("expected one of the #{name}, got: #{length(all)}: #{inspect(all)}")

  defp check!(true, _sentence), do: :ok
  defp check!(false, sentence), do: Rig.fail!(sentence)
end

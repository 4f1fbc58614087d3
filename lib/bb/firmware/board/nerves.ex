defmodule BB.Firmware.Board.Nerves do
  @moduledoc """
  A board that runs Nerves: `Nerves.Runtime` and the VM's `:heart`.

  Validating and reverting run the program `fwup` behind a process of Nerves (`FwupOps`) that is
  asked with a time-out of one second, which a slow card can exceed, and which exits then.
  `BB.Firmware.Board` makes an error of that; `revert/1` waits for what it has begun, because a
  second attempt behind a first one that was only slow would lead back to the firmware that is to
  go.

  Nerves' store (`KV`) asks `FwupOps` at its first use and ends when the answer is late; four such
  ends within five seconds end `nerves_runtime`. So `ready/1` asks `FwupOps` first, as often as it
  takes to have an answer in time: what is slow is the first run of `fwup`, from a cold card.
  """

  @behaviour BB.Firmware.Board

  alias Nerves.Runtime
  alias Nerves.Runtime.{FwupOps, Heart, KV}

  # They are there on boards alone, and there the compiler shall check what is called.
  unless Code.ensure_loaded?(Runtime),
    do: @compile({:no_warn_undefined, [Runtime, FwupOps, Heart, KV]})

  @fwup_limit_ms 30_000
  @ready_attempts 5
  @ready_pause_ms 2_000
  # What firmware/provisioning.conf writes; a variable that was not given is an empty string there.
  @ours "ganglion_"
  @shown ~w(nerves_fw_product nerves_fw_version nerves_fw_uuid nerves_fw_platform)

  @impl BB.Firmware.Board
  def ready(_handle) do
    with :ok <- repeat(&answer_in_time/0, @ready_attempts),
         do: repeat(&fill_store/0, @ready_attempts)
  end

  @impl BB.Firmware.Board
  def validation_status(_handle) do
    # Without the process that knows, Nerves says :unknown, as on a board that has no validation.
    if Process.whereis(KV),
      do: Runtime.firmware_validation_status(),
      else: {:error, :nerves_runtime_is_down}
  end

  # Where `fwup` fails, Nerves sets a variable that newer boards do not look at, and says :ok.
  @impl BB.Firmware.Board
  def validate(handle) do
    with :ok <- Runtime.validate_firmware(),
         :unvalidated <- validation_status(handle) do
      {:error, :still_unvalidated}
    else
      {:error, reason} -> {:error, reason}
      _validated -> :ok
    end
  end

  # Firmware that is not validated goes at the next restart anyway, where the board has that; so restart in any case.
  @impl BB.Firmware.Board
  def revert(handle) do
    _ = choose_the_other()
    reboot(handle)
  end

  @impl BB.Firmware.Board
  def prevent_revert(_handle) do
    finished(fn -> FwupOps.prevent_revert() end)
  end

  @impl BB.Firmware.Board
  def reboot(_handle), do: Runtime.reboot()

  @impl BB.Firmware.Board
  def init_complete(_handle), do: Heart.init_complete()

  @impl BB.Firmware.Board
  def set_heart(_handle, {module, function} = heart) do
    case :heart.get_callback() do
      {:ok, ^heart} -> :ok
      {:ok, other} -> {:error, {:taken, other}}
      :none -> done(:heart.set_callback(module, function))
    end
  end

  @impl BB.Firmware.Board
  def clear_heart(_handle, heart) do
    if :heart.get_callback() == {:ok, heart}, do: done(:heart.clear_callback()), else: :ok
  end

  @impl BB.Firmware.Board
  def firmware(_handle), do: Map.take(KV.get_all_active(), @shown)

  @impl BB.Firmware.Board
  def slot(_handle), do: Runtime.firmware_slots().active

  @impl BB.Firmware.Board
  def other(handle) do
    prefix = opposite(slot(handle)) <> "."
    all = KV.get_all()
    for name <- @shown, value = all[prefix <> name], value != "", into: %{}, do: {name, value}
  end

  @impl BB.Firmware.Board
  def provisioned(_handle),
    do: for({@ours <> name, value} when value != "" <- KV.get_all(), into: %{}, do: {name, value})

  defp choose_the_other, do: finished(fn -> Runtime.revert(reboot: false) end)

  # What was asked for goes on after a time-out; this is answered after it.
  defp finished(fun) do
    fun.()
  catch
    :exit, _timeout ->
      _ = :sys.get_state(FwupOps, @fwup_limit_ms)
      :ok
  end

  defp opposite("a"), do: "b"
  defp opposite("b"), do: "a"

  defp answer_in_time do
    _status = FwupOps.status()
    :ok
  catch
    :exit, reason ->
      _ = :sys.get_state(FwupOps, @fwup_limit_ms)
      {:error, reason}
  end

  defp fill_store do
    _ = KV.get("nerves_fw_devpath")
    :ok
  catch
    :exit, reason -> {:error, reason}
  end

  # The pause is long enough that a store that ends each time does not end its supervisor.
  defp repeat(fun, attempts) do
    case fun.() do
      {:error, _reason} when attempts > 1 ->
        Process.sleep(@ready_pause_ms)
        repeat(fun, attempts - 1)

      result ->
        result
    end
  end

  defp done(:ok), do: :ok
  defp done(other), do: {:error, other}
end

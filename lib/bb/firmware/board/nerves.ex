defmodule BB.Firmware.Board.Nerves do
  @moduledoc """
  A board that runs Nerves: `Nerves.Runtime` and the VM's `:heart`. Use it on every board with
  Nerves:

      config :ganglion, board: {BB.Firmware.Board.Nerves, []}

  Nerves validates and reverts with the program `fwup` behind a process, `FwupOps`. Its calls
  have a timeout of one second, which a slow card can exceed; the caller then exits.
  `BB.Firmware.Board` makes an error of that. `revert/1` waits for the slow call: a second call
  would switch back to the firmware that is to be left.

  Nerves' store (`KV`) calls `FwupOps` at its first use and ends when the reply is late; four such
  ends within five seconds end `nerves_runtime`. So `ready/1` calls `FwupOps` first, until a reply
  is in time: the first run of `fwup`, from a cold card, is the slow one.
  """

  @behaviour BB.Firmware.Board

  alias Nerves.Runtime
  alias Nerves.Runtime.{FwupOps, Heart, KV}

  # These modules exist on boards alone, where the compiler checks the calls.
  unless Code.ensure_loaded?(Runtime),
    do: @compile({:no_warn_undefined, [Runtime, FwupOps, Heart, KV]})

  @fwup_limit_ms 30_000
  @ready_attempts 5
  @ready_pause_ms 2_000
  # The prefix of variables that firmware/provisioning.conf writes; a missing one is an empty
  # string.
  @ours "ganglion_"
  @shown ~w(nerves_fw_product nerves_fw_version nerves_fw_uuid nerves_fw_platform)

  @impl BB.Firmware.Board
  def ready(_handle) do
    with :ok <- repeat(&answer_in_time/0, @ready_attempts),
         do: repeat(&fill_store/0, @ready_attempts)
  end

  @impl BB.Firmware.Board
  def validation_status(_handle) do
    # Without its store, Nerves returns :unknown, as on a board without validation.
    if Process.whereis(KV),
      do: Runtime.firmware_validation_status(),
      else: {:error, :nerves_runtime_is_down}
  end

  # When `fwup` fails, Nerves sets a variable that newer boards ignore, and returns :ok.
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

  # Boards with validation leave unvalidated firmware at the next restart, so restart in any case.
  @impl BB.Firmware.Board
  def revert(handle) do
    _ = switch_slot()
    reboot(handle)
  end

  @impl BB.Firmware.Board
  def prevent_revert(_handle) do
    await_fwup(fn -> FwupOps.prevent_revert() end)
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
      :none -> wrap_error(:heart.set_callback(module, function))
    end
  end

  @impl BB.Firmware.Board
  def clear_heart(_handle, heart) do
    if :heart.get_callback() == {:ok, heart}, do: wrap_error(:heart.clear_callback()), else: :ok
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

  defp switch_slot, do: await_fwup(fn -> Runtime.revert(reboot: false) end)

  # FwupOps continues after the timeout of a call, and replies to this call after it.
  defp await_fwup(fun) do
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

  # The pause is long enough that the repeated ends of the store do not end its supervisor.
  defp repeat(fun, attempts) do
    case fun.() do
      {:error, _reason} when attempts > 1 ->
        Process.sleep(@ready_pause_ms)
        repeat(fun, attempts - 1)

      result ->
        result
    end
  end

  defp wrap_error(:ok), do: :ok
  defp wrap_error(other), do: {:error, other}
end

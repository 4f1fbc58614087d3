defmodule BB.Firmware.Board do
  @moduledoc """
  The board under the firmware: validates, reverts and restarts it. This behaviour and its
  functions are the only way to a board; implement it for a board without Nerves.

      config :ganglion, board: {BB.Firmware.Board.Nerves, []}

  A board is `{module, handle}`: a module with the callbacks below, and their first argument.
  Three boards ship:

    * `BB.Firmware.Board.Nerves` - a real board with Nerves
    * `BB.Firmware.Board.Memory` - a board in memory, for tests
    * `BB.Firmware.Board.None` - no board, where firmware cannot be validated or reverted: the
      default, for the host

  The functions never raise and never exit: a fault of the board's module is `{:error, reason}`.
  """

  @type status :: :validated | :unvalidated | :unknown
  @type heart :: {module(), function :: atom()}
  @type t :: {module(), handle :: term()}

  @doc """
  Waits until the board answers the other callbacks in time. The programs behind them may be slow
  when they run first; this callback has no deadline.
  """
  @callback ready(handle :: term()) :: :ok | {:error, term()}

  @doc """
  Returns whether the running firmware stays after the next restart; `:unknown` for a board
  without validation.
  """
  @callback validation_status(handle :: term()) :: status() | {:error, term()}

  @doc "Validates the running firmware, so that it stays. A second call has no effect."
  @callback validate(handle :: term()) :: :ok | {:error, term()}

  @doc "Restarts the board with the previous firmware. It may never return."
  @callback revert(handle :: term()) :: :ok | {:error, term()}

  @doc "Prevents a later revert: the firmware in the other slot cannot be started any more."
  @callback prevent_revert(handle :: term()) :: :ok | {:error, term()}

  @doc "Restarts the board. It may never return."
  @callback reboot(handle :: term()) :: :ok | {:error, term()}

  @doc "Reports to the watchdog that the start of the system is complete."
  @callback init_complete(handle :: term()) :: :ok | {:error, term()}

  @doc """
  Sets the function that the VM's `:heart` calls before each beat. Fails when another function
  is set.
  """
  @callback set_heart(handle :: term(), heart()) :: :ok | {:error, term()}

  @doc "Clears the callback of the heart, if it is this function."
  @callback clear_heart(handle :: term(), heart()) :: :ok | {:error, term()}

  @doc "Returns facts about the running firmware: `%{\"nerves_fw_version\" => …}`."
  @callback firmware(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc "Returns the slot of the running firmware; `nil` for a board without slots."
  @callback slot(handle :: term()) :: String.t() | nil | {:error, term()}

  @doc "Returns facts about the firmware in the other slot; an empty map when it has none."
  @callback other(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc """
  Returns the settings on the board's card, for `BB.Firmware.Provisioning`. No value is an empty
  string.
  """
  @callback provisioned(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc "Returns the configured board."
  @spec configured() :: t()
  def configured, do: Application.get_env(:ganglion, :board, {BB.Firmware.Board.None, []})

  @doc "Calls `c:ready/1`."
  @spec ready(t()) :: :ok | {:error, term()}
  def ready(board), do: call(board, :ready, [])

  @doc """
  Calls `c:validation_status/1`.

      iex> BB.Firmware.Board.validation_status({BB.Firmware.Board.None, []})
      :unknown
      iex> BB.Firmware.Board.validation_status({NoBoard, []})
      {:error, {:undef, {NoBoard, :validation_status, 1}}}
  """
  @spec validation_status(t()) :: status() | {:error, term()}
  def validation_status(board), do: call(board, :validation_status, [])

  @doc "Calls `c:validate/1`."
  @spec validate(t()) :: :ok | {:error, term()}
  def validate(board), do: call(board, :validate, [])

  @doc "Calls `c:revert/1`."
  @spec revert(t()) :: :ok | {:error, term()}
  def revert(board), do: call(board, :revert, [])

  @doc "Calls `c:prevent_revert/1`."
  @spec prevent_revert(t()) :: :ok | {:error, term()}
  def prevent_revert(board), do: call(board, :prevent_revert, [])

  @doc "Calls `c:reboot/1`."
  @spec reboot(t()) :: :ok | {:error, term()}
  def reboot(board), do: call(board, :reboot, [])

  @doc "Calls `c:init_complete/1`."
  @spec init_complete(t()) :: :ok | {:error, term()}
  def init_complete(board), do: call(board, :init_complete, [])

  @doc "Calls `c:set_heart/2`."
  @spec set_heart(t(), heart()) :: :ok | {:error, term()}
  def set_heart(board, heart), do: call(board, :set_heart, [heart])

  @doc "Calls `c:clear_heart/2`."
  @spec clear_heart(t(), heart()) :: :ok | {:error, term()}
  def clear_heart(board, heart), do: call(board, :clear_heart, [heart])

  @doc "Calls `c:firmware/1`. Returns an empty map after an error."
  @spec firmware(t()) :: %{String.t() => String.t()}
  def firmware(board), do: map_or_empty(call(board, :firmware, []))

  @doc "Calls `c:slot/1`. Returns `nil` after an error."
  @spec slot(t()) :: String.t() | nil
  def slot(board) do
    case call(board, :slot, []) do
      slot when is_binary(slot) -> slot
      _unknown -> nil
    end
  end

  @doc "Calls `c:other/1`. Returns an empty map after an error."
  @spec other(t()) :: %{String.t() => String.t()}
  def other(board), do: map_or_empty(call(board, :other, []))

  @doc "Calls `c:provisioned/1`. Returns an empty map after an error."
  @spec provisioned(t()) :: %{String.t() => String.t()}
  def provisioned(board), do: map_or_empty(call(board, :provisioned, []))

  defp map_or_empty(%{} = known), do: known
  defp map_or_empty(_nothing), do: %{}

  defp call({module, handle}, function, args) do
    apply(module, function, [handle | args])
  rescue
    error in UndefinedFunctionError ->
      {:error, {:undef, {error.module, error.function, error.arity}}}

    error ->
      {:error, {:exception, Exception.message(error)}}
  catch
    :exit, {:timeout, _call} -> {:error, :timeout}
    kind, reason -> {:error, {kind, reason}}
  end
end

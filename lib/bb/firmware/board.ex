defmodule BB.Firmware.Board do
  @moduledoc """
  The board under the firmware: what validates, reverts and restarts it.

  A board is `{module, handle}`: a module with the callbacks below, and what it wants to be called with. There are three:

    * `BB.Firmware.Board.Nerves` - a real one
    * `BB.Firmware.Board.Memory` - a process that pretends, for tests
    * `BB.Firmware.Board.None` - where nothing can be validated or reverted: the host

  Which one it is says `config :ganglion, :board`; without that it is `BB.Firmware.Board.None`.

  The functions here never raise and never exit: what a board's module does wrong is `{:error, reason}`.
  """

  @type status :: :validated | :unvalidated | :unknown
  @type heart :: {module(), function :: atom()}
  @type t :: {module(), handle :: term()}

  @doc """
  Waits until the board can be asked the rest. Its store is behind programs that are slow at
  first, and that time is spent here, where nothing depends on an answer in time.
  """
  @callback ready(handle :: term()) :: :ok | {:error, term()}

  @doc "Whether the running firmware stays after the next restart; `:unknown` where the board does not tell."
  @callback validation_status(handle :: term()) :: status() | {:error, term()}

  @doc "Makes the running firmware the one that stays. Doing it twice is no harm."
  @callback validate(handle :: term()) :: :ok | {:error, term()}

  @doc "Restarts the board with the firmware before this one. It may never return."
  @callback revert(handle :: term()) :: :ok | {:error, term()}

  @doc "Closes the way back: nobody can start what is in the other slot any more."
  @callback prevent_revert(handle :: term()) :: :ok | {:error, term()}

  @doc "Restarts the board. It may never return."
  @callback reboot(handle :: term()) :: :ok | {:error, term()}

  @doc "Tells the watchdog that the system has come up as far as to watch over itself."
  @callback init_complete(handle :: term()) :: :ok | {:error, term()}

  @doc "Has the VM's `:heart` call that function without arguments before each beat. It refuses to take another one's place."
  @callback set_heart(handle :: term(), heart()) :: :ok | {:error, term()}

  @doc "Ends that, if it is this function that is called."
  @callback clear_heart(handle :: term(), heart()) :: :ok | {:error, term()}

  @doc "What is known of the running firmware, for a person: `%{\"nerves_fw_version\" => …}`."
  @callback firmware(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc "The slot of the running firmware; `nil` where there are no slots."
  @callback slot(handle :: term()) :: String.t() | nil | {:error, term()}

  @doc "What is known of the firmware in the other slot; an empty map where there is none."
  @callback other(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc "What the board's card was told when it was burned, as `BB.Firmware.Provisioning` reads it. Never an empty string."
  @callback provisioned(handle :: term()) :: %{String.t() => String.t()} | {:error, term()}

  @doc "The board that the configuration names."
  @spec configured() :: t()
  def configured, do: Application.get_env(:ganglion, :board, {BB.Firmware.Board.None, []})

  @doc "See `c:ready/1`."
  @spec ready(t()) :: :ok | {:error, term()}
  def ready(board), do: call(board, :ready, [])

  @doc """
  See `c:validation_status/1`.

      iex> BB.Firmware.Board.validation_status({BB.Firmware.Board.None, []})
      :unknown
      iex> BB.Firmware.Board.validation_status({NoBoard, []})
      {:error, {:undef, {NoBoard, :validation_status, 1}}}
  """
  @spec validation_status(t()) :: status() | {:error, term()}
  def validation_status(board), do: call(board, :validation_status, [])

  @doc "See `c:validate/1`."
  @spec validate(t()) :: :ok | {:error, term()}
  def validate(board), do: call(board, :validate, [])

  @doc "See `c:revert/1`."
  @spec revert(t()) :: :ok | {:error, term()}
  def revert(board), do: call(board, :revert, [])

  @doc "See `c:prevent_revert/1`."
  @spec prevent_revert(t()) :: :ok | {:error, term()}
  def prevent_revert(board), do: call(board, :prevent_revert, [])

  @doc "See `c:reboot/1`."
  @spec reboot(t()) :: :ok | {:error, term()}
  def reboot(board), do: call(board, :reboot, [])

  @doc "See `c:init_complete/1`."
  @spec init_complete(t()) :: :ok | {:error, term()}
  def init_complete(board), do: call(board, :init_complete, [])

  @doc "See `c:set_heart/2`."
  @spec set_heart(t(), heart()) :: :ok | {:error, term()}
  def set_heart(board, heart), do: call(board, :set_heart, [heart])

  @doc "See `c:clear_heart/2`."
  @spec clear_heart(t(), heart()) :: :ok | {:error, term()}
  def clear_heart(board, heart), do: call(board, :clear_heart, [heart])

  @doc "See `c:firmware/1`. An empty map where nothing is known."
  @spec firmware(t()) :: %{String.t() => String.t()}
  def firmware(board), do: known(call(board, :firmware, []))

  @doc "See `c:slot/1`. `nil` also where it is not known."
  @spec slot(t()) :: String.t() | nil
  def slot(board) do
    case call(board, :slot, []) do
      slot when is_binary(slot) -> slot
      _unknown -> nil
    end
  end

  @doc "See `c:other/1`. An empty map where nothing is known."
  @spec other(t()) :: %{String.t() => String.t()}
  def other(board), do: known(call(board, :other, []))

  @doc "See `c:provisioned/1`. An empty map where nothing is known."
  @spec provisioned(t()) :: %{String.t() => String.t()}
  def provisioned(board), do: known(call(board, :provisioned, []))

  defp known(%{} = known), do: known
  defp known(_nothing), do: %{}

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

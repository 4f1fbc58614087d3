defmodule BB.Firmware.Board.None do
  @moduledoc """
  The board of the host, which cannot be validated, reverted or restarted. It is the default of
  `BB.Firmware.Board`.

      iex> BB.Firmware.Board.validate({BB.Firmware.Board.None, []})
      {:error, :no_board}
  """

  @behaviour BB.Firmware.Board

  @impl BB.Firmware.Board
  def ready(_handle), do: :ok

  @impl BB.Firmware.Board
  def validation_status(_handle), do: :unknown

  @impl BB.Firmware.Board
  def validate(_handle), do: {:error, :no_board}

  @impl BB.Firmware.Board
  def revert(_handle), do: {:error, :no_board}

  @impl BB.Firmware.Board
  def prevent_revert(_handle), do: {:error, :no_board}

  @impl BB.Firmware.Board
  def reboot(_handle), do: {:error, :no_board}

  @impl BB.Firmware.Board
  def init_complete(_handle), do: :ok

  @impl BB.Firmware.Board
  def set_heart(_handle, _heart), do: {:error, :no_board}

  @impl BB.Firmware.Board
  def clear_heart(_handle, _heart), do: :ok

  @impl BB.Firmware.Board
  def firmware(_handle), do: %{}

  @impl BB.Firmware.Board
  def slot(_handle), do: nil

  @impl BB.Firmware.Board
  def other(_handle), do: %{}

  @impl BB.Firmware.Board
  def provisioned(_handle), do: %{}
end

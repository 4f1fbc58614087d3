defmodule BB.Sensor.Mpu6050.Chip do
  @moduledoc """
  The MPU-6050 on its bus: each function is one conversation with the chip, made of the bytes of `BB.Sensor.Mpu6050.Registers`.

  A function takes the time of its transfers and no more: whoever calls waits between them, as long as `reset_ms/0` and
  `settle_ms/0` say. What goes wrong is `{:error, t:BB.Bus.I2C.Device.reason/0}`.
  """
  alias BB.Bus.I2C.Device
  alias BB.Sensor.Mpu6050.Registers

  @enforce_keys [:device, :settings]
  defstruct [:device, :settings]

  @type t :: %__MODULE__{device: Device.t(), settings: Registers.settings()}

  @no_data <<0::size(Registers.reading_size())-unit(8)>>

  @doc "The datasheet's wait after a reset."
  def reset_ms, do: 100

  @doc "The gyroscope's start-up time, typically; before that its readings drift."
  def settle_ms, do: 30

  @doc "Gives the bus back."
  @spec close(t()) :: :ok
  def close(chip), do: Device.close(chip.device)

  @doc "Makes sure that this is an MPU-6050."
  @spec identify(t()) :: :ok | {:error, Device.reason()}
  def identify(chip), do: Device.identify(chip.device, Registers.who_am_i(), Registers.identity())

  @doc "Starts a reset, after which the chip is to be left alone for `reset_ms/0`."
  @spec reset(t()) :: :ok | {:error, Device.reason()}
  def reset(chip), do: write(chip, Registers.pwr_mgmt_1(), <<Registers.reset()>>)

  @doc "Wakes the chip, writes its settings and reads them back. Readings are good `settle_ms/0` later."
  @spec configure(t()) :: :ok | {:error, Device.reason()}
  def configure(chip) do
    settings = Registers.encode_settings(chip.settings)

    with :ok <- write(chip, Registers.pwr_mgmt_1(), <<Registers.awake()>>),
         :ok <- write(chip, Registers.smplrt_div(), settings),
         {:ok, power} <- read(chip, Registers.pwr_mgmt_1(), 1),
         {:ok, found} <- read(chip, Registers.smplrt_div(), byte_size(settings)) do
      if power == <<Registers.awake()>> and found == settings,
        do: :ok,
        else: {:error, Device.fault(chip.device, :not_configured)}
    end
  end

  @doc """
  The chip's latest sample, in one burst.

  A chip that lost its power for a moment is asleep, and its data registers are all 0, which a chip at work never shows: that is
  looked into, and an error.
  """
  @spec sample(t()) :: {:ok, Registers.reading()} | {:error, Device.reason()}
  def sample(chip) do
    case read(chip, Registers.accel_xout_h(), Registers.reading_size()) do
      {:ok, @no_data} -> with(:ok <- check_awake(chip), do: {:ok, decode(chip, @no_data)})
      {:ok, bytes} -> {:ok, decode(chip, bytes)}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Makes sure that the chip still is as `configure/1` left it, and not as after power-on."
  @spec check_awake(t()) :: :ok | {:error, Device.reason()}
  def check_awake(chip) do
    awake = Registers.awake()

    case read(chip, Registers.pwr_mgmt_1(), 1) do
      {:ok, <<^awake>>} -> :ok
      {:ok, _} -> {:error, Device.fault(chip.device, :restarted)}
      {:error, reason} -> {:error, reason}
    end
  end

  defp decode(chip, bytes),
    do: Registers.decode(bytes, chip.settings.accel_range, chip.settings.gyro_range)

  defp read(chip, register, count), do: Device.read(chip.device, register, count)
  defp write(chip, register, bytes), do: Device.write(chip.device, register, bytes)
end

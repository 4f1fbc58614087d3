defmodule BB.Sensor.Mpu6050.Chip do
  @moduledoc """
  The MPU-6050 on its bus: each function is one conversation with the chip, made of the bytes of `BB.Sensor.Mpu6050.Registers`.

  A function takes the time of its transfers and no more: whoever calls waits between them, as long as `reset_ms/0` and
  `settle_ms/0` say. What goes wrong is `{:error, t:BB.Sensor.Mpu6050.reason/0}`.
  """
  alias BB.Sensor.Mpu6050
  alias BB.Sensor.Mpu6050.Registers

  @enforce_keys [:i2c, :bus, :bus_name, :address, :settings]
  defstruct [:i2c, :bus, :bus_name, :address, :settings]

  @type t :: %__MODULE__{
          i2c: module(),
          bus: term(),
          bus_name: String.t(),
          address: byte(),
          settings: Registers.settings()
        }

  @no_data <<0::size(Registers.reading_size())-unit(8)>>

  @doc "The datasheet's wait after a reset."
  def reset_ms, do: 100

  @doc "The gyroscope's start-up time, typically; before that its readings drift."
  def settle_ms, do: 30

  @doc "Opens the bus. Nothing is asked of the chip yet."
  @spec open(module(), String.t(), byte(), timeout_ms :: pos_integer(), Registers.settings()) ::
          {:ok, t()} | {:error, Mpu6050.reason()}
  def open(i2c, bus_name, address, timeout_ms, settings) do
    chip = %__MODULE__{
      i2c: i2c,
      bus: nil,
      bus_name: bus_name,
      address: address,
      settings: settings
    }

    case i2c.open(bus_name, timeout: timeout_ms) do
      {:ok, bus} -> {:ok, %{chip | bus: bus}}
      {:error, error} -> {:error, reason(error, chip)}
    end
  end

  @doc "Gives the bus back."
  @spec close(t()) :: :ok
  def close(chip), do: chip.i2c.close(chip.bus)

  @doc "Makes sure that this is an MPU-6050."
  @spec identify(t()) :: :ok | {:error, Mpu6050.reason()}
  def identify(chip) do
    expected = Registers.identity()

    case read(chip, Registers.who_am_i(), 1) do
      {:ok, <<^expected>>} -> :ok
      {:ok, <<found>>} -> {:error, {:wrong_chip, chip.bus_name, chip.address, found, expected}}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Starts a reset, after which the chip is to be left alone for `reset_ms/0`."
  @spec reset(t()) :: :ok | {:error, Mpu6050.reason()}
  def reset(chip), do: write(chip, Registers.pwr_mgmt_1(), <<Registers.reset()>>)

  @doc "Wakes the chip, writes its settings and reads them back. Readings are good `settle_ms/0` later."
  @spec configure(t()) :: :ok | {:error, Mpu6050.reason()}
  def configure(chip) do
    settings = Registers.encode_settings(chip.settings)

    with :ok <- write(chip, Registers.pwr_mgmt_1(), <<Registers.awake()>>),
         :ok <- write(chip, Registers.smplrt_div(), settings),
         {:ok, power} <- read(chip, Registers.pwr_mgmt_1(), 1),
         {:ok, found} <- read(chip, Registers.smplrt_div(), byte_size(settings)) do
      if power == <<Registers.awake()>> and found == settings,
        do: :ok,
        else: {:error, {:not_configured, chip.bus_name, chip.address}}
    end
  end

  @doc """
  The chip's latest sample, in one burst.

  A chip that lost its power for a moment is asleep, and its data registers are all 0, which a chip at work never shows: that is
  looked into, and an error.
  """
  @spec sample(t()) :: {:ok, Registers.reading()} | {:error, Mpu6050.reason()}
  def sample(chip) do
    case read(chip, Registers.accel_xout_h(), Registers.reading_size()) do
      {:ok, @no_data} -> with(:ok <- check_awake(chip), do: {:ok, decode(chip, @no_data)})
      {:ok, bytes} -> {:ok, decode(chip, bytes)}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Makes sure that the chip still is as `configure/1` left it, and not as after power-on."
  @spec check_awake(t()) :: :ok | {:error, Mpu6050.reason()}
  def check_awake(chip) do
    awake = Registers.awake()

    case read(chip, Registers.pwr_mgmt_1(), 1) do
      {:ok, <<^awake>>} -> :ok
      {:ok, _} -> {:error, {:restarted, chip.bus_name, chip.address}}
      {:error, reason} -> {:error, reason}
    end
  end

  defp decode(chip, bytes),
    do: Registers.decode(bytes, chip.settings.accel_range, chip.settings.gyro_range)

  defp read(chip, register, count) do
    with {:error, error} <- chip.i2c.write_read(chip.bus, chip.address, <<register>>, count),
         do: {:error, reason(error, chip)}
  end

  defp write(chip, register, bytes) do
    with {:error, error} <- chip.i2c.write(chip.bus, chip.address, [register, bytes]),
         do: {:error, reason(error, chip)}
  end

  defp reason(error, chip) when error in [:i2c_nak, :enxio],
    do: {:no_answer, chip.bus_name, chip.address}

  defp reason(:timeout, chip), do: {:timeout, chip.bus_name, chip.address}
  defp reason(:bus_not_found, chip), do: {:bus_not_found, chip.bus_name}
  defp reason(error, chip), do: {:bus, chip.bus_name, chip.address, error}
end

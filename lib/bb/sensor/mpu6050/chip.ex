defmodule BB.Sensor.Mpu6050.Chip do
  @moduledoc """
  The MPU-6050 on its bus: each function makes the transfers of one operation.

  `BB.Sensor.Mpu6050` and `BB.Sensor.Mpu6050.DataReady` use it. The bytes come from
  `BB.Sensor.Mpu6050.Registers`. No function waits: the caller does, for `reset_ms/0` and
  `settle_ms/0`.

  `sample/1` and `fifo_count/1` also read the interrupt settings. A chip that lost its power for a
  moment has lost them, which is the error `:restarted`.
  """
  @moduledoc no_example: "internal: BB.Sensor.Mpu6050 is its interface"

  alias BB.Bus.I2C.Device
  alias BB.Sensor.Mpu6050.Registers

  @enforce_keys [:device, :settings]
  defstruct [:device, :settings, model: :mpu6050, pulses?: false]

  @typedoc "A chip. `:pulses?` is whether its pin INT signals each sample."
  @type t :: %__MODULE__{
          device: Device.t(),
          settings: Registers.settings(),
          model: Registers.model(),
          pulses?: boolean()
        }

  @typedoc "Why an operation fails: a reason of every device, or an overflow of the FIFO."
  @type reason :: Device.reason() | {:overflow, String.t(), Device.address()}

  @doc "Returns the datasheet's waiting time after a reset, for the caller to wait."
  @spec reset_ms() :: pos_integer()
  def reset_ms, do: 100

  @doc "Returns the gyroscope's typical start-up time, during which its readings drift."
  @spec settle_ms() :: pos_integer()
  def settle_ms, do: 30

  @doc "Closes the bus."
  @spec close(t()) :: :ok
  def close(chip), do: Device.close(chip.device)

  @doc "Returns the name of a chip's place."
  @spec place(String.t(), Device.address()) :: String.t()
  defdelegate place(bus, address), to: Device

  @doc "Checks that the chip is the model `wanted`, or any of the family (`nil`)."
  @spec identify(t(), Registers.model() | nil) :: {:ok, t()} | {:error, Device.reason()}
  def identify(chip, wanted \\ nil) do
    with {:ok, <<identity>>} <- Device.read(chip.device, Registers.who_am_i(), 1) do
      case Registers.model(identity) do
        {:ok, model} when wanted in [nil, model] -> {:ok, %{chip | model: model}}
        _other -> error(chip, :wrong_chip, [identity, Registers.identity(wanted || :mpu6050)])
      end
    end
  end

  @doc "Starts a reset. The next transfer must come `reset_ms/0` later."
  @spec reset(t()) :: :ok | {:error, Device.reason()}
  def reset(chip), do: Device.write(chip.device, Registers.pwr_mgmt_1(), <<Registers.reset()>>)

  @doc "Wakes the chip, and writes and checks its settings. Wait `settle_ms/0` before a reading."
  @spec configure(t()) :: :ok | {:error, Device.reason()}
  def configure(chip) do
    settings = Registers.encode_settings(chip.settings, chip.model)

    with :ok <- Device.write(chip.device, Registers.pwr_mgmt_1(), <<Registers.awake()>>),
         :ok <- Device.write(chip.device, Registers.smplrt_div(), settings),
         :ok <- Device.write(chip.device, Registers.int_pin_cfg(), interrupts(chip)),
         {:ok, power} <- Device.read(chip.device, Registers.pwr_mgmt_1(), 1),
         {:ok, found} <- Device.read(chip.device, Registers.smplrt_div(), byte_size(settings)) do
      if power == <<Registers.awake()>> and found == settings,
        do: :ok,
        else: error(chip, :not_configured)
    end
  end

  @doc "Reads the chip's latest sample, and whether it is new, in one transfer."
  @spec sample(t()) ::
          {:ok, Registers.reading(), new? :: boolean()} | {:error, Device.reason()}
  def sample(chip) do
    size = Registers.status_size()
    count = size + Registers.reading_size()

    with {:ok, bytes} <- Device.read(chip.device, Registers.int_pin_cfg(), count),
         {status, reading} = :erlang.split_binary(bytes, size),
         {:ok, status} <- status(chip, status),
         do: {:ok, decode(chip, reading), status.new?}
  end

  @doc "Empties the FIFO, and puts all samples into it from now on."
  @spec start_fifo(t()) :: :ok | {:error, Device.reason()}
  def start_fifo(chip) do
    with :ok <- Device.write(chip.device, Registers.user_ctrl(), <<Registers.fifo_emptied()>>),
         :ok <- Device.write(chip.device, Registers.user_ctrl(), <<Registers.fifo_on()>>),
         do: Device.write(chip.device, Registers.fifo_en(), <<Registers.all_in_fifo()>>)
  end

  @doc "Returns the number of samples in the FIFO."
  @spec fifo_count(t()) :: {:ok, non_neg_integer()} | {:error, reason()}
  def fifo_count(chip) do
    with {:ok, bytes} <-
           Device.read(chip.device, Registers.int_pin_cfg(), Registers.status_size()),
         {:ok, %{overflowed?: false}} <- status(chip, bytes),
         {:ok, <<size::16>>} <- Device.read(chip.device, Registers.fifo_count(), 2) do
      {:ok, div(size, Registers.reading_size())}
    else
      {:ok, %{overflowed?: true}} -> error(chip, :overflow)
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Takes the `count` oldest samples out of the FIFO."
  @spec take(t(), pos_integer()) :: {:ok, [Registers.reading()]} | {:error, Device.reason()}
  def take(chip, count) do
    size = Registers.reading_size()

    with {:ok, bytes} <- Device.read(chip.device, Registers.fifo_r_w(), count * size),
         do: {:ok, bytes |> frames(size) |> Enum.map(&decode(chip, &1))}
  end

  defp frames(<<>>, _size), do: []

  defp frames(bytes, size) do
    {frame, rest} = :erlang.split_binary(bytes, size)
    [frame | frames(rest, size)]
  end

  defp interrupts(chip), do: Registers.interrupts(chip.pulses?)

  defp status(chip, bytes) do
    with :restarted <- Registers.decode_status(bytes, interrupts(chip)),
         do: error(chip, :restarted)
  end

  defp decode(chip, bytes) do
    %{accel_range: accel_range, gyro_range: gyro_range} = chip.settings
    Registers.decode(bytes, accel_range, gyro_range, chip.model)
  end

  defp error(chip, kind, details \\ []), do: {:error, Device.fault(chip.device, kind, details)}
end

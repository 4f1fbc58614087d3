defmodule BB.Sensor.Mpu6050.Chip do
  @moduledoc """
  The chip on its bus: each function is one conversation with it, made of the bytes of `BB.Sensor.Mpu6050.Registers`.

  A function takes the time of its transfers and no more: whoever calls waits between them, as long as `reset_ms/0` and
  `settle_ms/0` say. What goes wrong is `{:error, t:BB.Bus.I2C.Device.reason/0}`, or the FIFO's overflow.

  Each reading begins with the interrupt settings, which a chip that lost its power for a moment has forgotten: then it is no reading, but
  the error `:restarted`.
  """
  alias BB.Bus.I2C.Device
  alias BB.Sensor.Mpu6050.Registers

  @enforce_keys [:device, :settings]
  defstruct [:device, :settings, model: :mpu6050, pulses?: false]

  @typedoc "`pulses?` is whether its pin INT tells of each sample."
  @type t :: %__MODULE__{
          device: Device.t(),
          settings: Registers.settings(),
          model: Registers.model(),
          pulses?: boolean()
        }

  @type reason :: Device.reason() | {:overflow, String.t(), Device.address()}

  @doc "The datasheet's wait after a reset."
  def reset_ms, do: 100

  @doc "The gyroscope's start-up time, typically; before that its readings drift."
  def settle_ms, do: 30

  @doc "Gives the bus back."
  @spec close(t()) :: :ok
  def close(chip), do: Device.close(chip.device)

  @doc "Where a chip is, in words."
  @spec place(String.t(), Device.address()) :: String.t()
  defdelegate place(bus, address), to: Device

  @doc "Makes sure that this is one of the family: the `model` that is asked for, or any (`nil`)."
  @spec identify(t(), Registers.model() | nil) :: {:ok, t()} | {:error, Device.reason()}
  def identify(chip, wanted \\ nil) do
    with {:ok, <<identity>>} <- read(chip, Registers.who_am_i(), 1) do
      case Registers.model(identity) do
        {:ok, model} when wanted in [nil, model] -> {:ok, %{chip | model: model}}
        _other -> error(chip, :wrong_chip, [identity, Registers.identity(wanted || :mpu6050)])
      end
    end
  end

  @doc "Starts a reset, after which the chip is to be left alone for `reset_ms/0`."
  @spec reset(t()) :: :ok | {:error, Device.reason()}
  def reset(chip), do: write(chip, Registers.pwr_mgmt_1(), <<Registers.reset()>>)

  @doc "Wakes the chip, writes its settings and reads them back. Readings are good `settle_ms/0` later."
  @spec configure(t()) :: :ok | {:error, Device.reason()}
  def configure(chip) do
    settings = Registers.encode_settings(chip.settings, chip.model)

    with :ok <- write(chip, Registers.pwr_mgmt_1(), <<Registers.awake()>>),
         :ok <- write(chip, Registers.smplrt_div(), settings),
         :ok <- write(chip, Registers.int_pin_cfg(), interrupts(chip)),
         {:ok, power} <- read(chip, Registers.pwr_mgmt_1(), 1),
         {:ok, found} <- read(chip, Registers.smplrt_div(), byte_size(settings)) do
      if power == <<Registers.awake()>> and found == settings,
        do: :ok,
        else: error(chip, :not_configured)
    end
  end

  @doc "The chip's latest sample and whether it is new, in one burst."
  @spec sample(t()) ::
          {:ok, Registers.reading(), new? :: boolean()} | {:error, Device.reason()}
  def sample(chip) do
    size = Registers.status_size()

    with {:ok, bytes} <- read(chip, Registers.int_pin_cfg(), size + Registers.reading_size()),
         {status, reading} = :erlang.split_binary(bytes, size),
         {:ok, status} <- status(chip, status),
         do: {:ok, decode(chip, reading), status.new?}
  end

  @doc "Has all samples from now on kept in the FIFO."
  @spec start_fifo(t()) :: :ok | {:error, Device.reason()}
  def start_fifo(chip) do
    with :ok <- write(chip, Registers.user_ctrl(), <<Registers.fifo_emptied()>>),
         :ok <- write(chip, Registers.user_ctrl(), <<Registers.fifo_on()>>),
         do: write(chip, Registers.fifo_en(), <<Registers.all_in_fifo()>>)
  end

  @doc "How many samples there are in the FIFO."
  @spec fifo_count(t()) :: {:ok, non_neg_integer()} | {:error, reason()}
  def fifo_count(chip) do
    with {:ok, bytes} <- read(chip, Registers.int_pin_cfg(), Registers.status_size()),
         {:ok, %{overflowed?: false}} <- status(chip, bytes),
         {:ok, <<size::16>>} <- read(chip, Registers.fifo_count(), 2) do
      {:ok, div(size, Registers.reading_size())}
    else
      {:ok, %{overflowed?: true}} -> error(chip, :overflow)
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Takes the oldest samples out of the FIFO."
  @spec take(t(), pos_integer()) :: {:ok, [Registers.reading()]} | {:error, Device.reason()}
  def take(chip, count) do
    size = Registers.reading_size()

    with {:ok, bytes} <- read(chip, Registers.fifo_r_w(), count * size),
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
  defp read(chip, register, count), do: Device.read(chip.device, register, count)
  defp write(chip, register, bytes), do: Device.write(chip.device, register, bytes)
end

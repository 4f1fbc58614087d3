defmodule BB.Sensor.Mpu6050.Registers do
  @moduledoc """
  Encodes and decodes the registers of the MPU-6050, and those of the MPU-6500 and the MPU-9250
  where they differ.

  `BB.Sensor.Mpu6050` uses it. The module is pure.

      iex> BB.Sensor.Mpu6050.Registers.model(0x70)
      {:ok, :mpu6500}

  The sources are RM-MPU-6000A rev. 4.2, PS-MPU-6000A rev. 3.4 (sensitivities), RM-MPU-6500A rev.
  2.1 and PS-MPU-6500A rev. 1.0.

  ## Models

  | model | WHO_AM_I | accelerometer's filter | temperature | after power-on |
  |---|---|---|---|---|
  | MPU-6050 | 0x68 | the gyroscope's filter | 36.53 °C + raw / 340 | asleep |
  | MPU-6500 | 0x70 | ACCEL_CONFIG_2 | 21 °C + raw / 333.87 | awake |
  | MPU-9250 | 0x71 | ACCEL_CONFIG_2 | 21 °C + raw / 333.87 | awake |

  The MPU-6500 and the MPU-9250 have five setting registers instead of four, and get the same
  filter in both filter registers. Their accelerometer has at most 1000 samples a second. With the
  filter at 260 each sample comes several times.

  ## Ranges

  A wider range has coarser steps:

  | accelerometer | LSB/g | gyroscope | LSB/(°/s) |
  |---|---|---|---|
  | ±2 g | 16384 | ±250 °/s | 131 |
  | ±4 g | 8192 | ±500 °/s | 65.5 |
  | ±8 g | 4096 | ±1000 °/s | 32.8 |
  | ±16 g | 2048 | ±2000 °/s | 16.4 |

  ## Rates

  The chip samples at 1000 Hz / (1 + divider), or at 8000 Hz / (1 + divider) with the filter at
  260 Hz, which is off. The divider is 0..255. See `divider/2`.
  """

  @typedoc "A member of the family."
  @type model :: :mpu6050 | :mpu6500 | :mpu9250

  @typedoc "The accelerometer's full scale in g."
  @type accel_range :: 2 | 4 | 8 | 16

  @typedoc "The gyroscope's full scale in degrees a second."
  @type gyro_range :: 250 | 500 | 1000 | 2000

  @typedoc """
  The low-pass filter's bandwidth in Hz for the accelerometer. The gyroscope's is within 5 % of
  it. 260 is no filter.
  """
  @type filter :: 5 | 10 | 20 | 44 | 94 | 184 | 260

  @typedoc """
  The settings in SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG and, where it exists,
  ACCEL_CONFIG_2.
  """
  @type settings :: %{
          divider: 0..255,
          filter: filter(),
          gyro_range: gyro_range(),
          accel_range: accel_range()
        }

  @typedoc "A reading in m/s², rad/s and °C, in the chip's axes."
  @type reading :: %{
          acceleration: {float(), float(), float()},
          angular_velocity: {float(), float(), float()},
          temperature: float()
        }

  @standard_gravity 9.80665
  @radian_per_degree :math.pi() / 180

  @identities %{0x68 => :mpu6050, 0x70 => :mpu6500, 0x71 => :mpu9250}

  # The temperature in °C at 0, and LSB/°C.
  @thermometers %{
    mpu6050: {36.53, 340},
    mpu6500: {21, 333.87},
    mpu9250: {21, 333.87}
  }

  # From the chip's code to its meaning.
  @accel_ranges %{0 => 2, 1 => 4, 2 => 8, 3 => 16}
  @gyro_ranges %{0 => 250, 1 => 500, 2 => 1000, 3 => 2000}
  @filters %{0 => 260, 1 => 184, 2 => 94, 3 => 44, 4 => 20, 5 => 10, 6 => 5}

  @lsb_per_g %{2 => 16_384, 4 => 8192, 8 => 4096, 16 => 2048}
  @lsb_per_degree_per_s %{250 => 131, 500 => 65.5, 1000 => 32.8, 2000 => 16.4}

  @doc "Returns the address of SMPLRT_DIV, the first of the registers of `encode_settings/2`."
  @spec smplrt_div() :: byte()
  def smplrt_div, do: 0x19

  @doc "Returns the address of FIFO_EN, which selects the contents of the FIFO."
  @spec fifo_en() :: byte()
  def fifo_en, do: 0x23

  @doc """
  Returns the value of FIFO_EN for acceleration, temperature and rotation, so that a frame in the
  FIFO has the bytes of `decode/4`.
  """
  @spec all_in_fifo() :: byte()
  def all_in_fifo, do: 0xF8

  @doc "Returns the address of INT_PIN_CFG, the first of the registers of `decode_status/2`."
  @spec int_pin_cfg() :: byte()
  def int_pin_cfg, do: 0x37

  @doc "Returns the number of bytes of `decode_status/2`. The bytes of a reading follow them."
  @spec status_size() :: pos_integer()
  def status_size, do: 4

  @doc "Returns the number of bytes of a reading (`decode/4`)."
  @spec reading_size() :: pos_integer()
  def reading_size, do: 14

  @doc """
  Returns the bytes of INT_PIN_CFG and INT_ENABLE: short pulses, active high, and any read clears
  INT_STATUS. With `pulses?` the pin pulses with each sample.
  """
  @spec interrupts(pulses? :: boolean()) :: <<_::16>>
  def interrupts(pulses?), do: <<0x10, if(pulses?, do: 0x01, else: 0x00)>>

  @doc """
  Decodes the four bytes from INT_PIN_CFG on of a chip with the interrupt settings `interrupts`.

  Returns whether a sample is new and whether the FIFO has overflowed, or `:restarted` when the
  settings are lost.

      iex> alias BB.Sensor.Mpu6050.Registers
      iex> Registers.decode_status(<<0x10, 0x01, 0x00, 0x11>>, <<0x10, 0x01>>)
      {:ok, %{new?: true, overflowed?: true}}
      iex> Registers.decode_status(<<0x00, 0x00, 0x00, 0x01>>, <<0x10, 0x01>>)
      :restarted
  """
  @spec decode_status(<<_::32>>, interrupts :: <<_::16>>) ::
          {:ok, %{new?: boolean(), overflowed?: boolean()}} | :restarted
  def decode_status(<<same::binary-2, _dmp, status>>, same) do
    <<_::3, overflowed::1, _::3, new::1>> = <<status>>
    {:ok, %{new?: new == 1, overflowed?: overflowed == 1}}
  end

  def decode_status(<<_::32>>, _interrupts), do: :restarted

  @doc "Returns the address of USER_CTRL."
  @spec user_ctrl() :: byte()
  def user_ctrl, do: 0x6A

  @doc "Returns the value of USER_CTRL that turns the FIFO off and empties it."
  @spec fifo_emptied() :: byte()
  def fifo_emptied, do: 0x04

  @doc "Returns the value of USER_CTRL that turns the FIFO on."
  @spec fifo_on() :: byte()
  def fifo_on, do: 0x40

  @doc "Returns the address of FIFO_COUNTH, two bytes: the number of bytes in the FIFO."
  @spec fifo_count() :: byte()
  def fifo_count, do: 0x72

  @doc "Returns the address of FIFO_R_W, at which bytes are taken out of the FIFO."
  @spec fifo_r_w() :: byte()
  def fifo_r_w, do: 0x74

  @doc "Returns the address of PWR_MGMT_1."
  @spec pwr_mgmt_1() :: byte()
  def pwr_mgmt_1, do: 0x6B

  @doc "Returns the address of WHO_AM_I."
  @spec who_am_i() :: byte()
  def who_am_i, do: 0x75

  @doc """
  Returns the model of a value of WHO_AM_I, which is the same at both addresses.

      iex> BB.Sensor.Mpu6050.Registers.model(0x19)
      :error
  """
  @spec model(byte()) :: {:ok, model()} | :error
  def model(identity), do: Map.fetch(@identities, identity)

  @doc "Returns all models."
  @spec models() :: [model()]
  def models, do: @identities |> Map.values() |> Enum.sort()

  @doc "Returns the value of a model's WHO_AM_I."
  @spec identity(model()) :: byte()
  def identity(model), do: code(@identities, model)

  @doc "Returns the value of PWR_MGMT_1 that resets the chip."
  @spec reset() :: byte()
  def reset, do: 0x80

  @doc """
  Returns the value of PWR_MGMT_1 that wakes the chip, with the X gyroscope's oscillator as its
  clock, which is steadier than the internal one.
  """
  @spec awake() :: byte()
  def awake, do: 0x01

  @doc "Returns the full scales of the accelerometer in g, ascending."
  @spec accel_ranges() :: [accel_range()]
  def accel_ranges, do: ascending(@accel_ranges)

  @doc "Returns the full scales of the gyroscope in degrees a second, ascending."
  @spec gyro_ranges() :: [gyro_range()]
  def gyro_ranges, do: ascending(@gyro_ranges)

  @doc "Returns the filter's bandwidths in Hz, ascending."
  @spec filters() :: [filter()]
  def filters, do: ascending(@filters)

  @doc """
  Returns the divider for the slowest rate of the chip that is not below `rate_hz`, so that each
  reading at that rate is a new sample. It is at most 255.

      iex> BB.Sensor.Mpu6050.Registers.divider(100, 44)
      9
      iex> BB.Sensor.Mpu6050.Registers.divider(300, 44)
      2
      iex> BB.Sensor.Mpu6050.Registers.divider(1000, 260)
      7
  """
  @spec divider(number(), filter()) :: 0..255
  def divider(rate_hz, filter) when rate_hz > 0,
    do: (trunc(base_hz(filter) / rate_hz) - 1) |> max(0) |> min(255)

  @doc """
  Returns the rate at which the chip samples, in Hz.

      iex> BB.Sensor.Mpu6050.Registers.sample_rate_hz(9, 44)
      100.0
      iex> BB.Sensor.Mpu6050.Registers.sample_rate_hz(255, 260)
      31.25
  """
  @spec sample_rate_hz(0..255, filter()) :: float()
  def sample_rate_hz(divider, filter) when divider in 0..255,
    do: base_hz(filter) / (1 + divider)

  defp base_hz(260), do: 8000
  defp base_hz(_filter), do: 1000

  @doc """
  Encodes SMPLRT_DIV, CONFIG, GYRO_CONFIG and ACCEL_CONFIG for these settings, and ACCEL_CONFIG_2
  where the model has it.

      iex> settings = %{divider: 9, filter: 44, gyro_range: 500, accel_range: 4}
      iex> BB.Sensor.Mpu6050.Registers.encode_settings(settings)
      <<9, 0x03, 0x08, 0x08>>
      iex> BB.Sensor.Mpu6050.Registers.encode_settings(settings, :mpu6500)
      <<9, 0x03, 0x08, 0x08, 0x03>>
  """
  @spec encode_settings(settings(), model()) :: <<_::32>> | <<_::40>>
  def encode_settings(settings, model \\ :mpu6050)

  def encode_settings(settings, model) when model != :mpu6050,
    do: encode_settings(settings) <> <<code(@filters, settings.filter)>>

  def encode_settings(settings, :mpu6050) do
    <<
      settings.divider,
      code(@filters, settings.filter),
      0::3,
      code(@gyro_ranges, settings.gyro_range)::2,
      0::3,
      0::3,
      code(@accel_ranges, settings.accel_range)::2,
      0::3
    >>
  end

  @doc """
  Decodes the settings in the four registers.

  Returns `:error` for a bit that the driver does not set (self-test, external sync, filter 7).

      iex> BB.Sensor.Mpu6050.Registers.decode_settings(<<9, 0x03, 0x18, 0x18>>)
      {:ok, %{divider: 9, filter: 44, gyro_range: 2000, accel_range: 16}}
      iex> BB.Sensor.Mpu6050.Registers.decode_settings(<<0, 0x07, 0, 0>>)
      :error
  """
  @spec decode_settings(<<_::32>>) :: {:ok, settings()} | :error
  def decode_settings(<<divider, 0::5, filter::3, 0::3, gyro::2, 0::3, 0::3, accel::2, 0::3>>)
      when is_map_key(@filters, filter) do
    {:ok,
     %{
       divider: divider,
       filter: @filters[filter],
       gyro_range: @gyro_ranges[gyro],
       accel_range: @accel_ranges[accel]
     }}
  end

  def decode_settings(<<_::32>>), do: :error

  @doc """
  Decodes the 14 bytes from ACCEL_XOUT_H on into acceleration, temperature and rotation in SI
  units.

      iex> bytes = <<0::16, 0::16, 16_384::16, 340::16, 131::16, 0::16, -131::16>>
      iex> reading = BB.Sensor.Mpu6050.Registers.decode(bytes, 2, 250)
      iex> reading.acceleration
      {0.0, 0.0, 9.80665}
      iex> Float.round(reading.temperature, 6)
      37.53
      iex> {x, _y, _z} = reading.angular_velocity
      iex> Float.round(x * 180 / :math.pi(), 6)
      1.0
  """
  @spec decode(<<_::112>>, accel_range(), gyro_range(), model()) :: reading()
  def decode(
        <<acceleration::binary-6, temperature::signed-16, rotation::binary-6>>,
        accel_range,
        gyro_range,
        model \\ :mpu6050
      ) do
    {zero, per_degree} = Map.fetch!(@thermometers, model)

    %{
      acceleration: vector(acceleration, acceleration_lsb(accel_range)),
      angular_velocity: vector(rotation, angular_velocity_lsb(gyro_range)),
      temperature: zero + temperature / per_degree
    }
  end

  @doc "Returns one step of the accelerometer in m/s²."
  @spec acceleration_lsb(accel_range()) :: float()
  def acceleration_lsb(range), do: @standard_gravity / Map.fetch!(@lsb_per_g, range)

  @doc "Returns one step of the gyroscope in rad/s."
  @spec angular_velocity_lsb(gyro_range()) :: float()
  def angular_velocity_lsb(range),
    do: @radian_per_degree / Map.fetch!(@lsb_per_degree_per_s, range)

  defp vector(<<x::signed-16, y::signed-16, z::signed-16>>, lsb), do: {x * lsb, y * lsb, z * lsb}

  defp code(table, meaning) do
    {code, _} = Enum.find(table, fn {_, candidate} -> candidate == meaning end)
    code
  end

  defp ascending(table), do: table |> Map.values() |> Enum.sort()
end

defmodule BB.Sensor.Mpu6050.Registers do
  @moduledoc """
  The registers of the MPU-6050, as bytes and as terms (RM-MPU-6000A rev. 4.2; sensitivities from PS-MPU-6000A rev. 3.4), and what is different in the
  MPU-6500 and MPU-9250 (RM-MPU-6500A rev. 2.1, PS-MPU-6500A rev. 1.0). Pure.

  ## Models

  | model | WHO_AM_I | accelerometer's filter | temperature | after power-on |
  |---|---|---|---|---|
  | MPU-6050 | 0x68 | that of the gyroscope | 36.53 °C + raw / 340 | asleep |
  | MPU-6500 | 0x70 | ACCEL_CONFIG_2 | 21 °C + raw / 333.87 | awake |
  | MPU-9250 | 0x71 | ACCEL_CONFIG_2 | 21 °C + raw / 333.87 | awake |

  An MPU-6500 and an MPU-9250 are set up by five registers instead of four, with the same filter for both. Their accelerometer has no more
  than 1000 samples a second: with the filter at 260 each comes several times.

  ## Ranges
  A wider range has coarser steps:

  | accelerometer | LSB/g | gyroscope | LSB/(°/s) |
  |---|---|---|---|
  | ±2 g | 16384 | ±250 °/s | 131 |
  | ±4 g | 8192 | ±500 °/s | 65.5 |
  | ±8 g | 4096 | ±1000 °/s | 32.8 |
  | ±16 g | 2048 | ±2000 °/s | 16.4 |

  ## Rates
  The chip samples at 1000 Hz / (1 + divider), or at 8000 Hz / (1 + divider) with the filter at 260 Hz, which is off; the
  divider is 0..255. See `divider/2`.
  """

  @typedoc "A member of the family."
  @type model :: :mpu6050 | :mpu6500 | :mpu9250

  @typedoc "The accelerometer's full scale in g."
  @type accel_range :: 2 | 4 | 8 | 16

  @typedoc "The gyroscope's full scale in degrees a second."
  @type gyro_range :: 250 | 500 | 1000 | 2000

  @typedoc "The low-pass filter's bandwidth in Hz, as the accelerometer has it; the gyroscope's is within 5 % of it. 260 is no filter."
  @type filter :: 5 | 10 | 20 | 44 | 94 | 184 | 260

  @typedoc "What is set in SMPLRT_DIV, CONFIG, GYRO_CONFIG, ACCEL_CONFIG and, where there is one, ACCEL_CONFIG_2."
  @type settings :: %{
          divider: 0..255,
          filter: filter(),
          gyro_range: gyro_range(),
          accel_range: accel_range()
        }

  @typedoc "m/s², rad/s and °C, in the chip's axes."
  @type reading :: %{
          acceleration: {float(), float(), float()},
          angular_velocity: {float(), float(), float()},
          temperature: float()
        }

  @standard_gravity 9.80665
  @radian_per_degree :math.pi() / 180

  @identities %{0x68 => :mpu6050, 0x70 => :mpu6500, 0x71 => :mpu9250}

  # In °C at 0, and LSB/°C.
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

  @doc "SMPLRT_DIV, the first of the registers of `encode_settings/2`."
  def smplrt_div, do: 0x19

  @doc "FIFO_EN: what goes into the FIFO."
  def fifo_en, do: 0x23

  @doc "FIFO_EN: acceleration, temperature and rotation, so that a frame in the FIFO is the bytes of `decode/4`."
  def all_in_fifo, do: 0xF8

  @doc "INT_PIN_CFG, the first of the registers of `decode_status/2`."
  def int_pin_cfg, do: 0x37

  @doc "The number of bytes of `decode_status/2`; those of a reading follow them."
  def status_size, do: 4

  @doc "The number of bytes of a reading, those of `decode/4`."
  def reading_size, do: 14

  @doc "INT_PIN_CFG and INT_ENABLE: short pulses, active high, and any read clears INT_STATUS; pulses with each sample if `pulses?`."
  @spec interrupts(pulses? :: boolean()) :: <<_::16>>
  def interrupts(pulses?), do: <<0x10, if(pulses?, do: 0x01, else: 0x00)>>

  @doc """
  The four bytes from INT_PIN_CFG on, of a chip whose interrupts were set to those bytes: whether there is a new sample, and whether the
  FIFO has overflowed. `:restarted` where the settings are not there any more.

      iex> BB.Sensor.Mpu6050.Registers.decode_status(<<0x10, 0x01, 0x00, 0x11>>, <<0x10, 0x01>>)
      {:ok, %{new?: true, overflowed?: true}}
      iex> BB.Sensor.Mpu6050.Registers.decode_status(<<0x00, 0x00, 0x00, 0x01>>, <<0x10, 0x01>>)
      :restarted
  """
  @spec decode_status(<<_::32>>, interrupts :: <<_::16>>) ::
          {:ok, %{new?: boolean(), overflowed?: boolean()}} | :restarted
  def decode_status(<<same::binary-2, _dmp, status>>, same) do
    <<_::3, overflowed::1, _::3, new::1>> = <<status>>
    {:ok, %{new?: new == 1, overflowed?: overflowed == 1}}
  end

  def decode_status(<<_::32>>, _interrupts), do: :restarted

  @doc "USER_CTRL."
  def user_ctrl, do: 0x6A

  @doc "USER_CTRL: the FIFO is off and empties itself."
  def fifo_emptied, do: 0x04

  @doc "USER_CTRL: the FIFO is on."
  def fifo_on, do: 0x40

  @doc "FIFO_COUNTH, the first of the two bytes of the number of bytes in the FIFO."
  def fifo_count, do: 0x72

  @doc "FIFO_R_W, where bytes are taken out of the FIFO."
  def fifo_r_w, do: 0x74

  @doc "PWR_MGMT_1."
  def pwr_mgmt_1, do: 0x6B

  @doc "WHO_AM_I."
  def who_am_i, do: 0x75

  @doc """
  The model that WHO_AM_I tells, at either address; `:error` for a stranger.

      iex> BB.Sensor.Mpu6050.Registers.model(0x70)
      {:ok, :mpu6500}
      iex> BB.Sensor.Mpu6050.Registers.model(0x19)
      :error
  """
  @spec model(byte()) :: {:ok, model()} | :error
  def model(identity), do: Map.fetch(@identities, identity)

  @doc "All models."
  @spec models() :: [model()]
  def models, do: @identities |> Map.values() |> Enum.sort()

  @doc "What a model's WHO_AM_I says."
  @spec identity(model()) :: byte()
  def identity(model), do: code(@identities, model)

  @doc "PWR_MGMT_1: reset the device."
  def reset, do: 0x80

  @doc "PWR_MGMT_1: awake, clocked by the X gyroscope's oscillator, which is steadier than the internal one."
  def awake, do: 0x01

  @doc "The full scales of the accelerometer in g, ascending."
  def accel_ranges, do: ascending(@accel_ranges)

  @doc "The full scales of the gyroscope in degrees a second, ascending."
  def gyro_ranges, do: ascending(@gyro_ranges)

  @doc "The filter's bandwidths in Hz, ascending."
  def filters, do: ascending(@filters)

  @doc """
  The divider for the slowest rate of the chip that is not below `rate_hz`, so that each reading at that rate is a new sample.
  Where even the largest divider is faster, that one.

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
  The rate at which the chip samples, in Hz.

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
  SMPLRT_DIV, CONFIG, GYRO_CONFIG and ACCEL_CONFIG for these settings, and ACCEL_CONFIG_2 where the model has it.

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
  The settings in the four registers; `:error` where there is a bit that this driver never sets (self-test, external sync, filter 7).

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
  The 14 bytes from ACCEL_XOUT_H on in SI units: acceleration, temperature, rotation.

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

  @doc "One step of the accelerometer in m/s²."
  @spec acceleration_lsb(accel_range()) :: float()
  def acceleration_lsb(range), do: @standard_gravity / Map.fetch!(@lsb_per_g, range)

  @doc "One step of the gyroscope in rad/s."
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

defmodule BB.Sensor.Mpu6050.Registers do
  @moduledoc """
  The registers of the MPU-6050, as bytes and as terms (RM-MPU-6000A rev. 4.2; sensitivities from PS-MPU-6000A rev. 3.4). Pure.

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

  @typedoc "The accelerometer's full scale in g."
  @type accel_range :: 2 | 4 | 8 | 16

  @typedoc "The gyroscope's full scale in degrees a second."
  @type gyro_range :: 250 | 500 | 1000 | 2000

  @typedoc "The low-pass filter's bandwidth in Hz, as the accelerometer has it; the gyroscope's is within 5 % of it. 260 is no filter."
  @type filter :: 5 | 10 | 20 | 44 | 94 | 184 | 260

  @typedoc "What is set in SMPLRT_DIV, CONFIG, GYRO_CONFIG and ACCEL_CONFIG."
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

  # From the chip's code to its meaning.
  @accel_ranges %{0 => 2, 1 => 4, 2 => 8, 3 => 16}
  @gyro_ranges %{0 => 250, 1 => 500, 2 => 1000, 3 => 2000}
  @filters %{0 => 260, 1 => 184, 2 => 94, 3 => 44, 4 => 20, 5 => 10, 6 => 5}

  @lsb_per_g %{2 => 16_384, 4 => 8192, 8 => 4096, 16 => 2048}
  @lsb_per_degree_per_s %{250 => 131, 500 => 65.5, 1000 => 32.8, 2000 => 16.4}

  @doc "SMPLRT_DIV, the first of the four registers of `encode_settings/1`."
  def smplrt_div, do: 0x19

  @doc "ACCEL_XOUT_H, the first of the 14 bytes of `decode/3`."
  def accel_xout_h, do: 0x3B

  @doc "The number of bytes of a reading."
  def reading_size, do: 14

  @doc "PWR_MGMT_1."
  def pwr_mgmt_1, do: 0x6B

  @doc "WHO_AM_I."
  def who_am_i, do: 0x75

  @doc "What WHO_AM_I says, at either address."
  def identity, do: 0x68

  @doc "PWR_MGMT_1: reset the device."
  def reset, do: 0x80

  @doc "PWR_MGMT_1 after power-on and reset: asleep."
  def asleep, do: 0x40

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
  SMPLRT_DIV, CONFIG, GYRO_CONFIG and ACCEL_CONFIG for these settings.

      iex> BB.Sensor.Mpu6050.Registers.encode_settings(%{divider: 9, filter: 44, gyro_range: 500, accel_range: 4})
      <<9, 0x03, 0x08, 0x08>>
  """
  @spec encode_settings(settings()) :: <<_::32>>
  def encode_settings(settings) do
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
  The 14 bytes from ACCEL_XOUT_H on in SI units: acceleration, temperature (36.53 °C + raw / 340), rotation.

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
  @spec decode(<<_::112>>, accel_range(), gyro_range()) :: reading()
  def decode(
        <<acceleration::binary-6, temperature::signed-16, rotation::binary-6>>,
        accel_range,
        gyro_range
      ) do
    %{
      acceleration: vector(acceleration, acceleration_lsb(accel_range)),
      angular_velocity: vector(rotation, angular_velocity_lsb(gyro_range)),
      temperature: 36.53 + temperature / 340
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

defmodule BB.Bus.Sim.Mpu6050.Model do
  @moduledoc """
  The differences between the MPU-6050 and its successors, and how each encodes a sample.

  `BB.Bus.Sim.Mpu6050` uses it. The module is pure.

      iex> BB.Bus.Sim.Mpu6050.Model.fetch!(:mpu6500).identity
      0x70
  """

  alias BB.Bus.Sim.Motion

  # PWR_MGMT_1 after power-on; bytes of the FIFO; temperature in °C at 0, and steps per °C.
  @models %{
    mpu6050: %{identity: 0x68, power: 0x40, fifo: 1024, zero: 36.53, per_degree: 340},
    mpu6500: %{identity: 0x70, power: 0x01, fifo: 512, zero: 21, per_degree: 333.87},
    mpu9250: %{identity: 0x71, power: 0x01, fifo: 512, zero: 21, per_degree: 333.87}
  }

  # Sensitivity by FS_SEL and AFS_SEL, from the product specification.
  @lsb_per_degree_per_s {131.0, 65.5, 32.8, 16.4}
  @lsb_per_g {16_384.0, 8192.0, 4096.0, 2048.0}
  @degree_per_radian 180 / :math.pi()

  @typedoc "The properties of a model."
  @type t :: %{
          identity: byte(),
          power: byte(),
          fifo: pos_integer(),
          zero: number(),
          per_degree: number()
        }

  @doc "Returns the properties of a model. Raises `ArgumentError` for an unknown one."
  @spec fetch!(atom()) :: t()
  def fetch!(name) when is_map_key(@models, name), do: @models[name]

  def fetch!(other) do
    names = @models |> Map.keys() |> Enum.sort()
    raise ArgumentError, "expected model: one of #{inspect(names)}, got: #{inspect(other)}"
  end

  @doc "Returns the 14 bytes from ACCEL_XOUT_H on for a sample."
  @spec encode(t(), Motion.sample(), afs_sel :: 0..3, fs_sel :: 0..3) :: <<_::112>>
  def encode(model, sample, afs_sel, fs_sel) do
    per_accel = elem(@lsb_per_g, afs_sel) / Motion.standard_gravity()
    per_rate = elem(@lsb_per_degree_per_s, fs_sel) * @degree_per_radian
    temperature = (sample.temperature - model.zero) * model.per_degree

    vector(sample.acceleration, per_accel) <>
      int16(temperature) <> vector(sample.angular_velocity, per_rate)
  end

  defp vector({x, y, z}, factor), do: int16(x * factor) <> int16(y * factor) <> int16(z * factor)

  defp int16(value), do: <<value |> round() |> max(-32_768) |> min(32_767)::16>>
end

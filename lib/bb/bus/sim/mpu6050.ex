defmodule BB.Bus.Sim.Mpu6050 do
  @moduledoc """
  A simulated InvenSense MPU-6050, register by register (RM-MPU-6000A rev. 4.2, PS-MPU-6000A rev. 3.4).

      BB.Bus.Sim.plug("i2c-1", 0x68, {BB.Bus.Sim.Mpu6050, source: :motion})

  ## Options
  - `:source`: what it feels, see `BB.Bus.Sim.Mpu6050.Source`; default `:motion`.
  - `:who_am_i`: the content of WHO_AM_I; default `0x68`, at the address 0x69 too. A relative of the chip says something else (MPU-6500: `0x70`).
  - `:reset_ms`: how long a DEVICE_RESET takes; default 20.

  ## What is modelled

  | register | behaviour |
  |---|---|
  | 0x19 SMPLRT_DIV | sample rate = 8 kHz (filter off: DLPF_CFG 0 or 7) or 1 kHz, divided by 1 + SMPLRT_DIV |
  | 0x1A CONFIG | DLPF_CFG chooses the base of the sample rate; the filter itself is not modelled |
  | 0x1B GYRO_CONFIG, 0x1C ACCEL_CONFIG | full-scale range, FS_SEL and AFS_SEL (bits 4:3); self-test bits are kept and do nothing |
  | 0x37 INT_PIN_CFG, 0x38 INT_ENABLE | kept; INT_RD_CLEAR (bit 4) makes any read clear INT_STATUS |
  | 0x3A INT_STATUS | DATA_RDY (bit 0): a sample came since it was last read; reading clears it |
  | 0x3B–0x48 | acceleration, temperature, rotation: 14 bytes, big-endian, all of one sample when read in one burst |
  | 0x6B PWR_MGMT_1 | DEVICE_RESET (bit 7) clears all registers and itself after the reset time; SLEEP (bit 6, set at power-on) and CLKSEL 7 stop the sampling |
  | 0x75 WHO_AM_I | read only |

  The registers 0x1F, 0x23–0x34, 0x63–0x67, 0x69, 0x6A and 0x6C keep what is written and do nothing: no FIFO, no auxiliary bus, no
  motion detection, no axis in standby. All others read 0 and cannot be written.

  Registers follow one another in a burst, for reading and for writing. While asleep the data registers keep their last content.
  During a reset writes are lost. Values beyond the range saturate; values are rounded to the nearest step. The first sample comes
  one sample period after waking; a new sample rate starts a new period.
  """
  @behaviour BB.Bus.Sim.Device

  alias BB.Bus.Sim.Motion
  alias BB.Bus.Sim.Mpu6050.Source

  @smplrt_div 0x19
  @config 0x1A
  @gyro_config 0x1B
  @accel_config 0x1C
  @int_pin_cfg 0x37
  @int_status 0x3A
  @data_first 0x3B
  @data_last 0x48
  @pwr_mgmt_1 0x6B
  @who_am_i 0x75
  @last_register 0x7F

  @writable [@smplrt_div, @config, @gyro_config, @accel_config, 0x1F] ++
              Enum.to_list(0x23..0x34) ++
              [@int_pin_cfg, 0x38] ++ Enum.to_list(0x63..0x67) ++ [0x69, 0x6A, @pwr_mgmt_1, 0x6C]

  @power_on %{@pwr_mgmt_1 => 0x40}
  @no_data <<0::14*8>>
  @device_reset 0x80
  @int_rd_clear 0x10

  # Sensitivity by FS_SEL and AFS_SEL, from the product specification.
  @lsb_per_degree_per_s {131.0, 65.5, 32.8, 16.4}
  @lsb_per_g {16_384.0, 8192.0, 4096.0, 2048.0}
  @degree_per_radian 180 / :math.pi()

  @enforce_keys [:source, :identity, :reset_ns, :powered_ns]
  defstruct [
    :source,
    :identity,
    :reset_ns,
    :powered_ns,
    registers: @power_on,
    pointer: 0,
    data: @no_data,
    data_ready?: false,
    reset_until_ns: nil,
    epoch_ns: nil,
    taken: 0
  ]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, source: :motion, who_am_i: 0x68, reset_ms: 20)

    {:ok,
     %__MODULE__{
       source: Source.new(opts[:source]),
       identity: integer!(opts, :who_am_i, 255),
       reset_ns: integer!(opts, :reset_ms, 60_000) * 1_000_000,
       powered_ns: now_ns
     }}
  end

  @impl true
  def write(<<pointer, values::binary>>, now_ns, chip) do
    chip = chip |> end_reset(now_ns) |> sample(now_ns)
    chip = put_all(%{chip | pointer: pointer}, values, now_ns)
    {:ok, chip}
  end

  @impl true
  def read(count, now_ns, chip) do
    addresses = addresses(chip.pointer, count)
    chip = chip |> end_reset(now_ns) |> sample(now_ns) |> step(addresses)
    bytes = for address <- addresses, into: <<>>, do: <<get(chip, address)>>
    {:ok, bytes, clear_status(%{chip | pointer: chip.pointer + count}, addresses)}
  end

  @doc """
  The 14 bytes from ACCEL_XOUT_H on for a sample, with the ranges AFS_SEL and FS_SEL (0..3 each).

      iex> at_rest = %{acceleration: {0.0, 0.0, 9.80665}, angular_velocity: {0.0, 0.0, 0.0}, temperature: 36.53}
      iex> BB.Bus.Sim.Mpu6050.encode(at_rest, 0, 0)
      <<0, 0, 0, 0, 0x40, 0x00, 0, 0, 0, 0, 0, 0, 0, 0>>
  """
  @spec encode(Motion.sample(), 0..3, 0..3) :: <<_::112>>
  def encode(sample, afs_sel, fs_sel) do
    per_accel = elem(@lsb_per_g, afs_sel) / Motion.standard_gravity()
    per_rate = elem(@lsb_per_degree_per_s, fs_sel) * @degree_per_radian
    temperature = (sample.temperature - 36.53) * 340

    vector(sample.acceleration, per_accel) <>
      int16(temperature) <> vector(sample.angular_velocity, per_rate)
  end

  defp vector({x, y, z}, factor), do: int16(x * factor) <> int16(y * factor) <> int16(z * factor)

  defp int16(value), do: <<value |> round() |> max(-32_768) |> min(32_767)::16>>

  defp integer!(opts, key, most) do
    value = opts[key]

    if is_integer(value) and value in 0..most,
      do: value,
      else:
        raise(ArgumentError, "expected #{key}: an integer in 0..#{most}, got: #{inspect(value)}")
  end

  # Registers as seen from the bus.

  defp addresses(_pointer, 0), do: []
  defp addresses(pointer, count), do: Enum.to_list(pointer..(pointer + count - 1)//1)

  defp get(chip, address) when address in @data_first..@data_last,
    do: :binary.at(chip.data, address - @data_first)

  defp get(chip, @int_status), do: if(chip.data_ready?, do: 1, else: 0)
  defp get(chip, @who_am_i), do: chip.identity

  defp get(%{reset_until_ns: until} = _chip, @pwr_mgmt_1) when until != nil,
    do: Bitwise.bor(@device_reset, 0x40)

  defp get(_chip, address) when address > @last_register, do: 0
  defp get(chip, address), do: Map.get(chip.registers, address, 0)

  defp put_all(chip, <<>>, _now_ns), do: chip

  defp put_all(chip, <<value, rest::binary>>, now_ns) do
    %{put(chip, chip.pointer, value, now_ns) | pointer: chip.pointer + 1} |> put_all(rest, now_ns)
  end

  defp put(%{reset_until_ns: until} = chip, _address, _value, _now_ns) when until != nil, do: chip

  defp put(chip, @pwr_mgmt_1, value, now_ns) when value >= @device_reset do
    end_reset(%{reset(chip) | reset_until_ns: now_ns + chip.reset_ns}, now_ns)
  end

  defp put(chip, address, value, now_ns) when address in @writable do
    changed = %{chip | registers: Map.put(chip.registers, address, value)}

    if period_ns(changed) == period_ns(chip),
      do: changed,
      else: %{changed | epoch_ns: now_ns, taken: 0}
  end

  defp put(chip, _address, _value, _now_ns), do: chip

  defp clear_status(chip, addresses) do
    any? = Bitwise.band(register(chip, @int_pin_cfg), @int_rd_clear) != 0
    if any? or @int_status in addresses, do: %{chip | data_ready?: false}, else: chip
  end

  # Reset.

  defp reset(chip), do: %{chip | registers: @power_on, data: @no_data, data_ready?: false}

  defp end_reset(%{reset_until_ns: until} = chip, now_ns) when until != nil and now_ns >= until,
    do: %{chip | reset_until_ns: nil}

  defp end_reset(chip, _now_ns), do: chip

  # Sampling.

  defp sample(chip, now_ns) do
    if Source.stepped?(chip.source), do: chip, else: sample(chip, now_ns, period_ns(chip))
  end

  defp sample(chip, _now_ns, nil), do: chip

  defp sample(chip, now_ns, period_ns) do
    count = div(now_ns - chip.epoch_ns, period_ns)

    if count > chip.taken do
      since_power_on_ns = chip.epoch_ns + count * period_ns - chip.powered_ns
      latch(%{chip | taken: count}, Source.at(chip.source, since_power_on_ns / 1.0e9))
    else
      chip
    end
  end

  defp step(chip, addresses) do
    with true <- Source.stepped?(chip.source) and @data_first in addresses,
         true <- period_ns(chip) != nil,
         {sample, source} <- Source.next(chip.source) do
      latch(%{chip | source: source}, sample)
    else
      _ -> chip
    end
  end

  defp latch(chip, sample) do
    data = encode(sample, range(chip, @accel_config), range(chip, @gyro_config))
    %{chip | data: data, data_ready?: true}
  end

  defp range(chip, address) do
    <<_self_test::3, range::2, _::3>> = <<register(chip, address)>>
    range
  end

  # The time between two samples; nil while none are taken.
  defp period_ns(chip) do
    <<_reset::1, sleep::1, _::3, clock::3>> = <<register(chip, @pwr_mgmt_1)>>

    if sleep == 0 and clock != 7,
      do: base_period_ns(chip) * (1 + register(chip, @smplrt_div))
  end

  defp base_period_ns(chip) do
    <<_::5, filter::3>> = <<register(chip, @config)>>
    if filter in [0, 7], do: 125_000, else: 1_000_000
  end

  defp register(chip, address), do: Map.get(chip.registers, address, 0)
end

defmodule BB.Bus.Sim.Mpu6050 do
  @moduledoc """
  A simulated InvenSense MPU-6050, register by register, or one of its successors, the MPU-6500
  and the MPU-9250.

  Use it to run `BB.Sensor.Mpu6050` without the chip.

      BB.Bus.Sim.plug("i2c-1", 0x68, {BB.Bus.Sim.Mpu6050, source: :motion})

  It follows RM-MPU-6000A rev. 4.2 and PS-MPU-6000A rev. 3.4, RM-MPU-6500A rev. 2.1 and
  RM-MPU-9250A rev. 1.6.

  ## Options

  - `:source`: the motion that it measures (`BB.Bus.Sim.Mpu6050.Source`); default `:motion`;
  - `:model`: `:mpu6050` (default), `:mpu6500` or `:mpu9250`;
  - `:interrupt`: the line to which its pin INT is wired, such as `{"gpiochip0", 4}` (see
    `BB.Bus.Sim.Lines`); default `nil`, none. The chip of lines needs the same clock as the bus;
  - `:who_am_i`: the content of WHO_AM_I, also at the address 0x69; by default 0x68, 0x70 or 0x71,
    by the model;
  - `:reset_ms`: how long a DEVICE_RESET takes; default 20.

  ## What is modelled

  | register | behaviour |
  |---|---|
  | 0x19 SMPLRT_DIV | sample rate = 8 kHz (filter off: DLPF_CFG 0 or 7) or 1 kHz, divided by 1 + SMPLRT_DIV |
  | 0x1A CONFIG | DLPF_CFG selects the base of the sample rate; the filter and FIFO_MODE are not modelled |
  | 0x1B GYRO_CONFIG, 0x1C ACCEL_CONFIG | full-scale range, FS_SEL and AFS_SEL (bits 4:3); self-test bits are stored and have no effect |
  | 0x23 FIFO_EN | the parts of each sample that go into the FIFO: acceleration (bit 3), temperature (7), rotation (6:4), in the order of the data registers |
  | 0x37 INT_PIN_CFG | stored; with INT_RD_CLEAR (bit 4) any read clears INT_STATUS. The pin is always active high and pulses for 50 µs |
  | 0x38 INT_ENABLE | DATA_RDY_EN (bit 0): the pin pulses with each sample. Other bits are stored |
  | 0x3A INT_STATUS | DATA_RDY (bit 0): a new sample since the last read; FIFO_OFLOW (bit 4): the FIFO overflowed; reading clears them |
  | 0x3B–0x48 | acceleration, temperature, rotation: 14 bytes, big-endian, all of one sample when read in one burst |
  | 0x6A USER_CTRL | FIFO_EN (bit 6); FIFO_RESET (bit 2) empties the FIFO when FIFO_EN is 0, and clears itself |
  | 0x6B PWR_MGMT_1 | DEVICE_RESET (bit 7) clears all registers and itself after the reset time; SLEEP (bit 6, set at power-on of an MPU-6050 only) and CLKSEL 7 stop the sampling |
  | 0x72–0x73 FIFO_COUNT | the number of bytes in the FIFO |
  | 0x74 FIFO_R_W | takes bytes out of the FIFO, also in a burst; 0xFF when it is empty |
  | 0x75 WHO_AM_I | read only |

  The FIFO has 1024 bytes (512 in the successors) and loses the oldest ones when it overflows. The
  registers 0x1D (of the successors), 0x1F, 0x24–0x34, 0x63–0x67, 0x69 and 0x6C store the bytes
  that are written and have no effect: no auxiliary bus, no motion detection, no axis in standby.
  All others read as 0 and cannot be written.

  Registers follow one another in a burst, for reading and for writing. During sleep the data
  registers do not change. During a reset writes are lost. Values beyond the range saturate, and
  values are rounded to the nearest step. The first sample comes one sample period after waking. A
  new sample rate starts a new period. A stepped source, which has no time, fills no FIFO and
  makes no pulses.
  """
  @behaviour BB.Bus.Sim.Device

  alias BB.Bus.Sim.{Burst, Motion}
  alias BB.Bus.Sim.Mpu6050.{Model, Source}

  @smplrt_div 0x19
  @config 0x1A
  @gyro_config 0x1B
  @accel_config 0x1C
  @int_pin_cfg 0x37
  @fifo_en 0x23
  @int_enable 0x38
  @int_status 0x3A
  @data_first 0x3B
  @data_last 0x48
  @user_ctrl 0x6A
  @pwr_mgmt_1 0x6B
  @fifo_count_h 0x72
  @fifo_count_l 0x73
  @fifo_r_w 0x74
  @who_am_i 0x75
  @last_register 0x7F

  @writable [@smplrt_div, @config, @gyro_config, @accel_config, 0x1D, 0x1F] ++
              Enum.to_list(@fifo_en..0x34) ++
              [@int_pin_cfg, @int_enable] ++
              Enum.to_list(0x63..0x67) ++ [0x69, @user_ctrl, @pwr_mgmt_1, 0x6C]

  @no_data <<0::14*8>>
  @device_reset 0x80
  @int_rd_clear 0x10
  @data_ready 0x01
  @overflowed 0x10
  @fifo_on 0x40
  @fifo_reset 0x04
  @pulse_ns 50_000

  @enforce_keys [:source, :model, :identity, :line, :reset_ns, :powered_ns, :epoch_ns, :registers]
  defstruct [
    :source,
    :model,
    :identity,
    :line,
    :reset_ns,
    :powered_ns,
    :epoch_ns,
    :registers,
    pointer: 0,
    data: @no_data,
    data_ready?: false,
    fifo: <<>>,
    overflowed?: false,
    reset_until_ns: nil,
    taken: 0
  ]

  @impl true
  def init(opts, now_ns) do
    defaults = [source: :motion, model: :mpu6050, interrupt: nil, who_am_i: nil, reset_ms: 20]
    opts = Keyword.validate!(opts, defaults)
    model = Model.fetch!(opts[:model])

    {:ok,
     %__MODULE__{
       source: Source.new(opts[:source]),
       model: model,
       identity: integer!(:who_am_i, opts[:who_am_i] || model.identity, 255),
       line: opts[:interrupt],
       reset_ns: integer!(:reset_ms, opts[:reset_ms], 60_000) * 1_000_000,
       powered_ns: now_ns,
       epoch_ns: now_ns,
       registers: power_on(model)
     }}
  end

  @impl true
  def write(bytes, now_ns, chip) do
    chip = chip |> end_reset(now_ns) |> sample(now_ns)
    {:ok, Burst.write(bytes, chip, &put(&1, &2, &3, now_ns))}
  end

  @impl true
  def read(count, now_ns, %{pointer: @fifo_r_w} = chip) do
    chip = chip |> end_reset(now_ns) |> sample(now_ns)
    taken = min(count, byte_size(chip.fifo))
    {bytes, rest} = :erlang.split_binary(chip.fifo, taken)
    {:ok, bytes <> :binary.copy(<<0xFF>>, count - taken), %{chip | fifo: rest}}
  end

  def read(count, now_ns, chip) do
    addresses = chip.pointer..(chip.pointer + count - 1)
    chip = chip |> end_reset(now_ns) |> sample(now_ns) |> take_step(addresses)
    {bytes, chip} = Burst.read(count, chip, &get(chip, &1))
    {:ok, bytes, clear_status(chip, addresses)}
  end

  @impl true
  def pulses(_from_ns, _to_ns, %{line: nil}), do: nil

  def pulses(from_ns, to_ns, chip) do
    if pulses?(chip) do
      period_ns = period_ns(chip)
      first = max(Integer.floor_div(from_ns - chip.epoch_ns, period_ns), 0) + 1
      next = max(Integer.floor_div(to_ns - chip.epoch_ns, period_ns), 0) + 1
      times = for n <- first..(next - 1)//1, do: chip.epoch_ns + n * period_ns

      %{
        line: chip.line,
        width_ns: @pulse_ns,
        times_ns: times,
        next_ns: chip.epoch_ns + next * period_ns
      }
    end
  end

  defp pulses?(chip) do
    ready? = Bitwise.band(register(chip, @int_enable), @data_ready) != 0
    ready? and chip.reset_until_ns == nil and samples?(chip)
  end

  @doc """
  Returns the 14 bytes from ACCEL_XOUT_H on for a sample, with the ranges AFS_SEL and FS_SEL
  (0..3).

      iex> at_rest = %{
      ...>   acceleration: {0.0, 0.0, 9.80665},
      ...>   angular_velocity: {0.0, 0.0, 0.0},
      ...>   temperature: 36.53
      ...> }
      iex> BB.Bus.Sim.Mpu6050.encode(at_rest, 0, 0)
      <<0, 0, 0, 0, 0x40, 0x00, 0, 0, 0, 0, 0, 0, 0, 0>>
  """
  @spec encode(Motion.sample(), 0..3, 0..3, atom()) :: <<_::112>>
  def encode(sample, afs_sel, fs_sel, model \\ :mpu6050),
    do: Model.encode(Model.fetch!(model), sample, afs_sel, fs_sel)

  defp integer!(_key, value, most) when is_integer(value) and value >= 0 and value <= most,
    do: value

  defp integer!(key, value, most) do
    raise ArgumentError, "expected #{key}: an integer in 0..#{most}, got: #{inspect(value)}"
  end

  # Registers.

  defp get(chip, address) when address in @data_first..@data_last,
    do: :binary.at(chip.data, address - @data_first)

  defp get(chip, @int_status) do
    ready = if chip.data_ready?, do: @data_ready, else: 0
    if chip.overflowed?, do: ready + @overflowed, else: ready
  end

  defp get(chip, @fifo_count_h), do: chip.fifo |> byte_size() |> div(256)
  defp get(chip, @fifo_count_l), do: chip.fifo |> byte_size() |> rem(256)
  defp get(chip, @who_am_i), do: chip.identity

  defp get(%{reset_until_ns: until} = chip, @pwr_mgmt_1) when until != nil,
    do: Bitwise.bor(@device_reset, chip.model.power)

  defp get(_chip, address) when address > @last_register, do: 0
  defp get(chip, address), do: Map.get(chip.registers, address, 0)

  defp put(%{reset_until_ns: until} = chip, _address, _value, _now_ns) when until != nil, do: chip

  defp put(chip, @pwr_mgmt_1, value, now_ns) when value >= @device_reset do
    end_reset(%{reset(chip) | reset_until_ns: now_ns + chip.reset_ns}, now_ns)
  end

  defp put(chip, @user_ctrl, value, _now_ns) do
    kept = Bitwise.band(value, Bitwise.bnot(@fifo_reset))
    empties? = Bitwise.band(value, @fifo_reset) != 0 and Bitwise.band(value, @fifo_on) == 0
    chip = %{chip | registers: Map.put(chip.registers, @user_ctrl, kept)}
    if empties?, do: %{chip | fifo: <<>>}, else: chip
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
    cleared = %{chip | data_ready?: false, overflowed?: false}
    if any? or @int_status in addresses, do: cleared, else: chip
  end

  # Reset.

  defp reset(chip) do
    %{
      chip
      | registers: power_on(chip.model),
        data: @no_data,
        data_ready?: false,
        fifo: <<>>,
        overflowed?: false
    }
  end

  defp power_on(model), do: %{@pwr_mgmt_1 => model.power}

  defp end_reset(%{reset_until_ns: until} = chip, now_ns) when until != nil and now_ns >= until,
    do: %{chip | reset_until_ns: nil, epoch_ns: until, taken: 0}

  defp end_reset(chip, _now_ns), do: chip

  # Sampling.

  defp sample(chip, now_ns) do
    if samples?(chip), do: sample_until(chip, now_ns, period_ns(chip)), else: chip
  end

  defp samples?(chip),
    do: chip.reset_until_ns == nil and not Source.stepped?(chip.source) and period_ns(chip) != nil

  # Only the samples that still fit into the FIFO are computed.
  defp sample_until(chip, now_ns, period_ns) do
    count = div(now_ns - chip.epoch_ns, period_ns)
    kept = if fills_fifo?(chip), do: div(chip.model.fifo, 2) + 1, else: 1
    first = max(chip.taken + 1, count - kept + 1)

    for n <- first..count//1, reduce: chip do
      chip -> take_sample(chip, n, chip.epoch_ns + n * period_ns)
    end
  end

  defp take_sample(chip, n, time_ns) do
    seconds = (time_ns - chip.powered_ns) / 1.0e9
    %{chip | taken: n} |> put_data(Source.at(chip.source, seconds)) |> fill_fifo()
  end

  defp fills_fifo?(chip), do: Bitwise.band(register(chip, @user_ctrl), @fifo_on) != 0

  defp fill_fifo(chip) do
    if fills_fifo?(chip), do: put_fifo(chip, chip.fifo <> frame(chip)), else: chip
  end

  defp put_fifo(chip, bytes) do
    case byte_size(bytes) - chip.model.fifo do
      over when over > 0 ->
        {_lost, kept} = :erlang.split_binary(bytes, over)
        %{chip | fifo: kept, overflowed?: true}

      _fits ->
        %{chip | fifo: bytes}
    end
  end

  defp frame(chip) do
    <<acceleration::binary-6, temperature::binary-2, x::binary-2, y::binary-2, z::binary-2>> =
      chip.data

    <<t::1, gx::1, gy::1, gz::1, a::1, _::3>> = <<register(chip, @fifo_en)>>
    parts = [{a, acceleration}, {t, temperature}, {gx, x}, {gy, y}, {gz, z}]
    for {1, bytes} <- parts, into: <<>>, do: bytes
  end

  defp take_step(chip, addresses) do
    with true <- Source.stepped?(chip.source) and @data_first in addresses,
         true <- period_ns(chip) != nil,
         {sample, source} <- Source.next(chip.source) do
      put_data(%{chip | source: source}, sample)
    else
      _ -> chip
    end
  end

  defp put_data(chip, sample) do
    afs_sel = range(chip, @accel_config)
    fs_sel = range(chip, @gyro_config)
    %{chip | data: Model.encode(chip.model, sample, afs_sel, fs_sel), data_ready?: true}
  end

  defp range(chip, address) do
    <<_self_test::3, range::2, _::3>> = <<register(chip, address)>>
    range
  end

  # nil while the chip does not sample.
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

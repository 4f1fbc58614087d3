defmodule BB.Sensor.As5600.Registers do
  @moduledoc """
  Encodes and decodes the registers of the AS5600 (ams datasheet v1-06, figures 21 and 22).

  `BB.Sensor.As5600` uses it. Angles are in steps, of which a turn has 4096. The module is pure.

      iex> BB.Sensor.As5600.Registers.decode_angle(<<0x0F, 0xFF>>)
      4095
  """

  @typedoc "The strength of the magnet, from STATUS."
  @type magnet :: :good | :too_weak | :too_strong | :missing

  @typedoc "The settings in CONF: the samples of the slow filter, and the hysteresis in steps."
  @type settings :: %{filter: 2 | 4 | 8 | 16, hysteresis: 0..3}

  @steps 4096

  # SF
  @filters %{0b00 => 16, 0b01 => 8, 0b10 => 4, 0b11 => 2}

  @doc "Returns the address of CONF, two bytes, the first of those of `decode_state/1`."
  @spec conf() :: byte()
  def conf, do: 0x07

  @doc "Returns the number of bytes from CONF to STATUS."
  @spec state_size() :: pos_integer()
  def state_size, do: 5

  @doc """
  Returns the address of RAW ANGLE, two bytes: the angle without the zero and the range that can
  be programmed into the chip.
  """
  @spec raw_angle() :: byte()
  def raw_angle, do: 0x0C

  @doc "Returns the steps of a turn."
  @spec steps() :: pos_integer()
  def steps, do: @steps

  @doc "Returns the settings of the slow filter, ascending."
  @spec filters() :: [pos_integer()]
  def filters, do: @filters |> Map.values() |> Enum.sort()

  @doc """
  Encodes CONF with these settings, at full power and without watchdog.

  The other bits stay as in the bytes given, because some of them are set in the factory.

      iex> BB.Sensor.As5600.Registers.encode_conf(%{filter: 16, hysteresis: 0}, <<0xE3, 0xFF>>)
      <<0xC0, 0xF0>>
      iex> BB.Sensor.As5600.Registers.encode_conf(%{filter: 2, hysteresis: 3}, <<0, 0>>)
      <<0x03, 0x0C>>
  """
  @spec encode_conf(settings(), <<_::16>>) :: <<_::16>>
  def encode_conf(
        settings,
        <<factory::2, _watchdog::1, threshold::3, _filter::2, output::4, _::4>>
      ) do
    {filter, _samples} = Enum.find(@filters, fn {_code, n} -> n == settings.filter end)
    <<factory::2, 0::1, threshold::3, filter::2, output::4, settings.hysteresis::2, 0::2>>
  end

  @doc """
  Returns CONF with the filter and the hysteresis inverted, which no other chip keeps by chance.

      iex> BB.Sensor.As5600.Registers.inverted(<<0x00, 0x04>>)
      <<0x03, 0x08>>
  """
  @spec inverted(<<_::16>>) :: <<_::16>>
  def inverted(<<high::6, filter::2, low::4, hysteresis::2, power::2>>),
    do: <<high::6, 3 - filter::2, low::4, 3 - hysteresis::2, power::2>>

  @doc """
  Decodes the bytes from CONF (0x07) to STATUS (0x0B) into CONF and the strength of the magnet.

      iex> BB.Sensor.As5600.Registers.decode_state(<<0x03, 0x0C, 0, 0, 0x20>>)
      {<<0x03, 0x0C>>, :good}
  """
  @spec decode_state(<<_::40>>) :: {<<_::16>>, magnet()}
  def decode_state(<<conf::binary-2, _::binary-2, status::binary-1>>),
    do: {conf, decode_status(status)}

  @doc """
  Decodes the magnet bits of STATUS: detected (MD, bit 5), too weak (ML, bit 4), too strong (MH,
  bit 3).

      iex> alias BB.Sensor.As5600.Registers
      iex> for status <- [0x20, 0x30, 0x28, 0x10, 0x67], do: Registers.decode_status(<<status>>)
      [:good, :too_weak, :too_strong, :missing, :good]
  """
  @spec decode_status(<<_::8>>) :: magnet()
  def decode_status(<<_::2, 0::1, _::5>>), do: :missing
  def decode_status(<<_::3, _::1, 1::1, _::3>>), do: :too_strong
  def decode_status(<<_::3, 1::1, _::4>>), do: :too_weak
  def decode_status(<<_::8>>), do: :good

  @doc "Decodes RAW ANGLE into steps."
  @spec decode_angle(<<_::16>>) :: 0..4095
  def decode_angle(<<_::4, steps::12>>), do: steps

  @doc """
  Converts steps into rad.

      iex> BB.Sensor.As5600.Registers.radians(1024) == :math.pi() / 2
      true
  """
  @spec radians(number()) :: float()
  def radians(steps), do: steps * 2 * :math.pi() / @steps
end

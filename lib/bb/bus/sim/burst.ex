defmodule BB.Bus.Sim.Burst do
  @moduledoc """
  Reads and writes registers of one byte that follow one another in a transfer.

  Models of chips (`BB.Bus.Sim.Device`) with such registers use it. The chip is a map or struct
  with a `:pointer`, the register of the next byte. The module is pure.

      iex> alias BB.Bus.Sim.Burst
      iex> chip = Burst.write(<<7, 1, 2>>, %{pointer: 0}, &Map.put(&1, &2, &3))
      iex> {bytes, _chip} = Burst.read(2, %{chip | pointer: 7}, &Map.fetch!(chip, &1))
      iex> bytes
      <<1, 2>>
  """

  @typedoc "A chip with its pointer."
  @type chip :: %{:pointer => non_neg_integer(), optional(atom()) => term()}

  @doc """
  Sets the pointer to the first byte, and writes each of the others with `put`.

  `put` gets the chip, the register and the value, and returns the chip.
  """
  @spec write(binary(), chip(), (chip(), non_neg_integer(), byte() -> chip())) :: chip()
  def write(<<pointer, values::binary>>, chip, put) do
    for <<value <- values>>, reduce: %{chip | pointer: pointer} do
      chip -> %{put.(chip, chip.pointer, value) | pointer: chip.pointer + 1}
    end
  end

  @doc """
  Returns the bytes from the pointer on, and the chip with its pointer behind them.

  `get` returns the byte of a register.
  """
  @spec read(pos_integer(), chip(), (non_neg_integer() -> byte())) :: {binary(), chip()}
  def read(count, chip, get) do
    bytes = for i <- 0..(count - 1), into: <<>>, do: <<get.(chip.pointer + i)>>
    {bytes, %{chip | pointer: chip.pointer + count}}
  end
end

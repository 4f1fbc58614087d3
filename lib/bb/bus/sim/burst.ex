defmodule BB.Bus.Sim.Burst do
  @moduledoc """
  Registers of one byte that follow one another in a transfer, as most chips have them. Pure.

  The chip is a struct with a `:pointer`, the register at which the next byte is read or written.
  """

  @type chip :: %{:pointer => non_neg_integer(), optional(atom()) => term()}

  @doc "Sets the pointer to the first byte, and has each of the others written by `put`: it gets chip, register and value, and returns the chip."
  @spec write(binary(), chip(), (chip(), non_neg_integer(), byte() -> chip())) :: chip()
  def write(<<pointer, values::binary>>, chip, put) do
    for <<value <- values>>, reduce: %{chip | pointer: pointer} do
      chip -> %{put.(chip, chip.pointer, value) | pointer: chip.pointer + 1}
    end
  end

  @doc """
  The bytes from the pointer on, each given by `get` for its register, and the chip with its pointer behind them.

      iex> chip = BB.Bus.Sim.Burst.write(<<7, 1, 2>>, %{pointer: 0}, &Map.put(&1, &2, &3))
      iex> {bytes, _chip} = BB.Bus.Sim.Burst.read(2, %{chip | pointer: 7}, &Map.fetch!(chip, &1))
      iex> bytes
      <<1, 2>>
  """
  @spec read(pos_integer(), chip(), (non_neg_integer() -> byte())) :: {binary(), chip()}
  def read(count, chip, get) do
    bytes = for i <- 0..(count - 1), into: <<>>, do: <<get.(chip.pointer + i)>>
    {bytes, %{chip | pointer: chip.pointer + count}}
  end
end

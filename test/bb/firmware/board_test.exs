defmodule BB.Firmware.BoardTest do
  use ExUnit.Case, async: true

  alias BB.Firmware.Board

  doctest Board
  doctest BB.Firmware.Board.None

  defmodule Wild do
    def validate(:raise), do: raise("no card")
    def validate(:late), do: exit({:timeout, {GenServer, :call, []}})
    def validate(:throw), do: throw(:ball)
  end

  test "what a board's module does wrong is an error" do
    assert Board.validate({Wild, :raise}) == {:error, {:exception, "no card"}}
    assert Board.validate({Wild, :late}) == {:error, :timeout}
    assert Board.validate({Wild, :throw}) == {:error, {:throw, :ball}}
    assert Board.firmware({Wild, []}) == %{}
  end

  test "without one there is nothing to validate, revert or restart" do
    none = {Board.None, []}

    for call <- [&Board.validate/1, &Board.revert/1, &Board.reboot/1],
        do: assert(call.(none) == {:error, :no_board})

    assert Board.init_complete(none) == :ok
    assert Board.set_heart(none, {A, :b}) == {:error, :no_board}
    assert Board.clear_heart(none, {A, :b}) == :ok
  end

  test "one in memory keeps one heart callback and gives it to nobody else" do
    {:ok, memory} = Board.Memory.start_link()
    board = {Board.Memory, memory}
    assert Board.set_heart(board, {A, :b}) == :ok
    assert Board.set_heart(board, {A, :b}) == :ok
    assert Board.set_heart(board, {C, :d}) == {:error, {:taken, {A, :b}}}
    assert Board.clear_heart(board, {C, :d}) == :ok
    assert Board.Memory.heart(memory) == {A, :b}
    assert Board.clear_heart(board, {A, :b}) == :ok
    assert Board.Memory.heart(memory) == nil
  end
end

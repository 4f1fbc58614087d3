defmodule BB.Bus.I2C.RecoveryTest do
  use ExUnit.Case, async: true

  alias BB.Bus.I2C.Recovery

  doctest BB.Bus.I2C.Recovery

  @timeout {:error, :timeout}

  # Records the results of transfers, each {address, result}, with `in_use` addresses.
  defp transfer(recovery, answers, in_use) do
    Enum.reduce(answers, recovery, fn {address, answer}, recovery ->
      Recovery.transferred(recovery, address, answer, in_use, 0)
    end)
  end

  defp up, do: Recovery.opened(Recovery.new())

  defp phase_after(answers, in_use), do: transfer(up(), answers, in_use).phase

  describe "a bus that is up" do
    test "is stuck when two addresses time out with no answer between" do
      assert phase_after([{1, @timeout}], [1, 2]) == :up
      assert phase_after([{1, @timeout}, {2, @timeout}], [1, 2]) == :down
    end

    test "is not when a device answers in between, even with a NAK" do
      for answer <- [:ok, {:ok, <<1>>}, {:error, :i2c_nak}, {:error, :retry}] do
        assert phase_after([{1, @timeout}, {3, answer}, {2, @timeout}], [1, 2, 3]) == :up
      end
    end

    test "is stuck after three timeouts of the only address in use" do
      assert phase_after([{1, @timeout}, {1, @timeout}], [1]) == :up
      assert phase_after([{1, @timeout}, {1, @timeout}, {1, @timeout}], [1]) == :down
    end

    test "is not stuck for one address, however often it times out, while others are in use" do
      assert phase_after(for(_ <- 1..1000, do: {1, @timeout}), [1, 2]) == :up
    end

    test "is not stuck for two that fail while others answer" do
      failing = [{1, @timeout}, {3, :ok}, {2, @timeout}, {3, :ok}]
      again = [{1, @timeout}, {2, @timeout}, {1, @timeout}]
      assert phase_after(failing ++ again, [1, 2, 3]) == :up
      assert phase_after(failing ++ again ++ [{3, @timeout}], [1, 2, 3]) == :up

      all = failing ++ again ++ for _ <- 1..3, do: {3, @timeout}
      assert phase_after(all, [1, 2, 3]) == :down
    end

    test "counts an address again that answered since" do
      failed = [{1, @timeout}, {3, :ok}, {2, @timeout}, {3, :ok}]
      answered = [{1, :ok}, {2, :ok}]

      assert phase_after(failed ++ answered ++ [{1, @timeout}, {2, @timeout}], [1, 2, 3]) ==
               :down
    end

    test "is down at once when its adapter is gone" do
      for errno <- [9, 19] do
        recovery = transfer(up(), [{1, {:error, {:errno, errno}}}], [1, 2])
        assert Recovery.next_step(recovery, 0) == {:error, {:errno, errno}}
      end

      assert phase_after([{1, {:error, {:errno, 5}}}], [1]) == :up
    end
  end

  describe "a bus that is down" do
    test "is opened after 10 ms, then after twice as long each time, at most 100 ms" do
      down = transfer(up(), [{1, @timeout}, {2, @timeout}], [1, 2])

      Enum.reduce([10, 20, 40, 80, 100, 100], down, fn delay_ms, down ->
        assert Recovery.next_step(down, delay_ms - 1) == {:error, :timeout}
        assert Recovery.next_step(down, delay_ms) == :open
        trying = Recovery.opened(down)
        assert Recovery.next_step(trying, delay_ms) == :transfer
        transfer(trying, [{1, @timeout}, {2, @timeout}], [1, 2])
      end)
    end

    test "also waits longer when it cannot be opened, and returns the reason" do
      down = transfer(up(), [{1, {:error, {:errno, 19}}}], [1])
      down = Recovery.open_failed(down, :bus_not_found, 10)
      assert Recovery.next_step(down, 29) == {:error, :bus_not_found}
      assert Recovery.next_step(down, 30) == :open
    end
  end

  describe "a bus that is tried" do
    setup do
      %{trying: up() |> transfer([{1, @timeout}, {2, @timeout}], [1, 2]) |> Recovery.opened()}
    end

    test "is up with the first answer, and starts again with 10 ms", %{trying: trying} do
      well = transfer(trying, [{1, @timeout}, {2, {:error, :i2c_nak}}], [1, 2])
      assert well.phase == :up
      down = transfer(well, [{2, @timeout}, {3, @timeout}], [1, 2, 3])
      assert Recovery.next_step(down, 10) == :open
    end

    test "is not taken down by one address of several", %{trying: trying} do
      assert transfer(trying, [{1, @timeout}, {1, @timeout}], [1, 2]).phase == :trying
    end

    test "is taken down by one timeout of the only address in use", %{trying: trying} do
      assert transfer(trying, [{1, @timeout}], [1]).phase == :down
    end
  end

  test "timeouts at every address are trouble, those at one of several addresses are not" do
    refute Recovery.troubled?(Recovery.new())
    refute Recovery.troubled?(up())
    assert Recovery.troubled?(transfer(up(), [{1, @timeout}], [1]))
    refute Recovery.troubled?(transfer(up(), [{1, @timeout}, {2, :ok}], [1, 2]))
    assert Recovery.troubled?(transfer(up(), [{1, @timeout}, {2, @timeout}], [1, 2]))
  end
end

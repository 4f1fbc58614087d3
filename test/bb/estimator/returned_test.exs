defmodule BB.Estimator.ReturnedTest do
  use ExUnit.Case, async: true

  alias BB.Estimator.Returned
  alias BB.Message
  alias BB.Message.Sensor.Contact

  doctest Returned

  @outputs [out: Message.new!(Contact, :test, pressed: true)]

  test "a reply of any callback but handle_call has outputs" do
    assert Returned.split(:handle_info, {:reply, @outputs, 1}) == {@outputs, {:noreply, 1}}
    assert Returned.split(:handle_cast, {:reply, @outputs, 1, 5}) == {@outputs, {:noreply, 1, 5}}
    assert Returned.split(:handle_continue, {:noreply, 1}) == {[], {:noreply, 1}}
    assert Returned.split(:handle_input, {:stop, :oops, 1}) == {[], {:stop, :oops, 1}}
  end

  test "a reply of handle_call has outputs before the state" do
    assert Returned.split(:handle_call, {:reply, 1, @outputs, 2}) == {@outputs, {:reply, 1, 2}}
    assert Returned.split(:handle_call, {:reply, 1, [], 2}) == {[], {:reply, 1, [], 2}}
    assert Returned.split(:handle_call, {:reply, 1, [], %{}}) == {[], {:reply, 1, %{}}}

    assert Returned.split(:handle_call, {:reply, 1, @outputs, 2, :hibernate}) ==
             {@outputs, {:reply, 1, 2, :hibernate}}
  end

  test "a reply of handle_call without outputs does not change" do
    for next <- [100, :infinity, :hibernate, {:continue, 1}], state <- [%{}, [], [a: 1]] do
      returned = {:reply, 1, state, next}
      assert Returned.split(:handle_call, returned) == {[], returned}
    end

    assert Returned.split(:handle_call, {:reply, 1, 2}) == {[], {:reply, 1, 2}}
  end
end

defmodule BB.PubSub.SubscriptionTest do
  use ExUnit.Case, async: true

  import BB.Test.Numbered

  alias BB.PubSub

  setup :start_pub_sub

  describe "wrong options" do
    test "raise ArgumentError saying what was given and what is accepted", %{robot: robot} do
      for {opts, message} <- [
            {[max_rate: 0], ~r/max_rate option.*expected.* got: 0/s},
            {[max_rate: -1.0],
             ~r/max_rate option.*expected a rate in Hz, a number above 0, got: -1.0/s},
            {[max_queue: -1],
             "invalid value for :max_queue option: expected non negative integer, got: -1"},
            {[replay: 1], "invalid value for :replay option: expected boolean, got: 1"},
            {[exact: nil], "invalid value for :exact option: expected boolean, got: nil"},
            {[unique: :yes], "invalid value for :unique option: expected boolean, got: :yes"},
            {[rate: 1],
             ~r/unknown options \[:rate\], valid options are: \[:message_types, :max_rate, /},
            {:all, "invalid options: expected keyword list, got: :all"}
          ] do
        assert_raise ArgumentError, message, fn -> PubSub.subscribe(robot, [:a], opts) end
      end
    end

    test "leave no subscription behind", %{robot: robot} do
      assert_raise ArgumentError, fn -> PubSub.subscribe(robot, [:a], max_rate: 0) end
      assert PubSub.subscribers(robot, [:a]) == []
    end
  end

  describe "exact" do
    test "is this path only, no descendants", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], exact: true)
      for path <- [[:a], [:a, :b], []], do: publish(robot, path, [1])
      assert numbers(actor) == [{[:a], 1}]
    end
  end
end

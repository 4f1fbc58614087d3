defmodule BB.TransmissionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2]

  alias BB.Message
  alias BB.Message.Actuator.{BeginMotion, Command, EndMotion}
  alias BB.Message.Sensor.{JointState, PowerState}
  alias BB.Transmission

  doctest BB.Transmission

  @reversed %{reduction: 50.0, offset: 0.25, reversed?: true}

  defp transmission do
    map({float(0.01, 500.0), float(-10.0, 10.0), boolean()}, fn {reduction, offset, reversed?} ->
      %{reduction: reduction, offset: offset, reversed?: reversed?}
    end)
  end

  defp value, do: float(-1.0e3, 1.0e3)

  test "position motor = s·r·(joint − offset); rate motor = s·r·joint; effort motor = s·joint/r" do
    assert Transmission.apply_position(1.25, @reversed) == -50.0
    assert Transmission.apply_rate(2.0, @reversed) == -100.0
    assert Transmission.apply_effort(100.0, @reversed) == -2.0
    forwards = %{@reversed | reversed?: false}
    assert Transmission.apply_position(1.25, forwards) == 50.0
    assert Transmission.apply_rate(2.0, forwards) == 100.0
    assert Transmission.apply_effort(100.0, forwards) == 2.0
  end

  property "unapply_position, unapply_rate and unapply_effort are the exact inverses of apply_*",
    numtests: 300 do
    forall {t, v} <- {transmission(), value()} do
      Enum.all?(
        [
          {&Transmission.apply_position/2, &Transmission.unapply_position/2},
          {&Transmission.apply_rate/2, &Transmission.unapply_rate/2},
          {&Transmission.apply_effort/2, &Transmission.unapply_effort/2}
        ],
        fn {there, back} ->
          close?(back.(there.(v, t), t), v) and close?(there.(back.(v, t), t), v)
        end
      )
    end
  end

  property "power is the same on both sides: effort times rate" do
    forall {t, effort, rate} <- {transmission(), value(), value()} do
      close?(
        Transmission.apply_effort(effort, t) * Transmission.apply_rate(rate, t),
        effort * rate
      )
    end
  end

  property "nil is the identity" do
    forall v <- value() do
      Enum.all?(
        [
          &Transmission.apply_position/2,
          &Transmission.unapply_position/2,
          &Transmission.apply_rate/2,
          &Transmission.unapply_rate/2,
          &Transmission.apply_effort/2,
          &Transmission.unapply_effort/2,
          &Transmission.apply_to_command/2,
          &Transmission.unapply_to_payload/2
        ],
        &(&1.(v, nil) === v)
      )
    end
  end

  describe "unapply_to_payload" do
    test "converts a JointState value by value" do
      message =
        Message.new!(JointState, :elbow,
          names: [:a, :b],
          positions: [-50.0, 0.0],
          velocities: [-100.0, 50.0],
          efforts: [-2.0, 1.0]
        )

      joint = Transmission.unapply_to_payload(message, @reversed)
      assert joint.payload.positions == [1.25, 0.25]
      assert joint.payload.velocities == [2.0, -1.0]
      assert joint.payload.efforts == [100.0, -50.0]
      assert %{joint | payload: nil} == %{message | payload: nil}
    end

    test "leaves values of planar and floating joints, and other payloads, unchanged" do
      pose = BB.Math.Transform2D.new(1.0, 2.0, 3.0)
      message = Message.new!(JointState, :base, names: [:a], positions: [pose])
      assert Transmission.unapply_to_payload(message, @reversed) == message
      message = Message.new!(PowerState, :battery, voltage: 7.0, current: 1.0)
      assert Transmission.unapply_to_payload(message, @reversed) == message
    end

    test "converts a BeginMotion, its rates as magnitudes" do
      message =
        Message.new!(BeginMotion, :servo,
          initial_position: -50.0,
          target_position: 0.0,
          expected_arrival: 1_000,
          peak_velocity: 100.0
        )

      motion = Transmission.unapply_to_payload(message, @reversed).payload
      assert %{initial_position: 1.25, target_position: 0.25, peak_velocity: 2.0} = motion
      assert %{acceleration: nil, expected_arrival: 1_000} = motion
      assert Transmission.unapply_to_payload(message.payload, @reversed) == motion
    end

    test "leaves an EndMotion unchanged" do
      message = Message.new!(EndMotion, :servo, position: 1.0, reason: :completed)
      assert Transmission.unapply_to_payload(message, @reversed) == message
    end
  end

  describe "apply_to_command" do
    test "converts Position, Velocity and Effort" do
      for {module, joint, motor} <- [
            {Command.Position, [position: 1.25], %{position: -50.0, velocity: nil}},
            {Command.Position, [position: 0.25, velocity: 2.0],
             %{position: 0.0, velocity: -100.0}},
            {Command.Velocity, [velocity: 2.0, duration: 5], %{velocity: -100.0, duration: 5}},
            {Command.Effort, [effort: 100.0], %{effort: -2.0}}
          ] do
        message = Message.new!(module, :servo, joint)
        applied = Transmission.apply_to_command(message, @reversed)
        assert Map.take(applied.payload, Map.keys(motor)) == motor
        assert %{applied | payload: nil} == %{message | payload: nil}
      end
    end

    test "converts a Trajectory point by point" do
      message =
        Message.new!(Command.Trajectory, :servo,
          waypoints: [[position: 1.25, velocity: 2.0, acceleration: 1.0, time_from_start: 10]]
        )

      assert [[position: -50.0, velocity: -100.0, acceleration: -50.0, time_from_start: 10]] =
               Transmission.apply_to_command(message, @reversed).payload.waypoints
               |> Enum.map(
                 &Keyword.take(&1, [:position, :velocity, :acceleration, :time_from_start])
               )
               |> Enum.map(&Enum.sort_by(&1, fn {key, _} -> key_order(key) end))
    end

    test "leaves the absent rates of a Trajectory absent" do
      for {waypoint, motor} <- [
            {[position: 1.25, time_from_start: 10], [position: -50.0, time_from_start: 10]},
            {[position: 1.25, velocity: nil, time_from_start: 0],
             [position: -50.0, velocity: nil, time_from_start: 0]},
            {[position: 1.25, acceleration: 1.0, time_from_start: 0],
             [position: -50.0, acceleration: -50.0, time_from_start: 0]}
          ] do
        message = Message.new!(Command.Trajectory, :servo, waypoints: [waypoint])
        assert [applied] = Transmission.apply_to_command(message, @reversed).payload.waypoints
        assert Enum.sort(applied) == Enum.sort(motor)
      end
    end

    defp key_order(key),
      do: Enum.find_index([:position, :velocity, :acceleration, :time_from_start], &(&1 == key))

    test "leaves Hold, Stop and other payloads unchanged" do
      for message <- [
            Message.new!(Command.Hold, :servo, []),
            Message.new!(Command.Stop, :servo, []),
            Message.new!(PowerState, :battery, voltage: 7.0, current: 1.0)
          ],
          do: assert(Transmission.apply_to_command(message, @reversed) == message)
    end
  end
end

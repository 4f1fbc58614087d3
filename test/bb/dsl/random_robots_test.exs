defmodule BB.Dsl.RandomRobotsTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Unit

  @length ~w(meter centimeter millimeter kilometer)a
  @angle ~w(degree radian)a
  @mass ~w(kilogram gram)a
  @inertia ~w(kilogram_square_meter gram_square_meter)a

  # The units of a joint's fields, and what they are in SI, by BB.Unit.
  @turning %{
    position: @angle,
    effort: ~w(newton_meter)a,
    velocity: ~w(degree_per_second radian_per_second)a,
    acceleration: ~w(degree_per_square_second radian_per_square_second)a,
    damping: ~w(newton_meter_second_per_degree newton_meter_second_per_radian)a,
    friction: ~w(newton_meter)a
  }

  @sliding %{
    position: @length,
    effort: ~w(newton kilonewton)a,
    velocity: ~w(meter_per_second kilometer_per_hour)a,
    acceleration: ~w(meter_per_square_second)a,
    damping: ~w(newton_second_per_meter)a,
    friction: ~w(newton)a
  }

  @types [:revolute, :continuous, :prismatic, :planar, :floating, :fixed]

  property "a robot of random words compiles to a struct that holds them in SI", numtests: 25 do
    forall seed <- integer(1, 1_000_000) do
      :rand.seed(:exsss, seed)
      {source, expected} = link("base", 1 + :rand.uniform(4))
      module = Module.concat(__MODULE__, "R#{System.unique_integer([:positive])}")
      source = "defmodule #{inspect(module)} do\nuse BB\ntopology do\n#{source}\nend\nend"
      [{^module, _}] = Code.compile_string(source, "random.ex")
      robot = module.robot()

      for {keys, value} <- expected,
          do: assert_same(get_in(robot, Enum.map(keys, &Access.key!/1)), value, keys, source)

      assert map_size(robot.links) == map_size(robot.joints) + 1
      BB.Robot.Builder.build(module) == robot
    end
  end

  # The source of a link with what it carries, and what the struct holds of it: {keys, value}.
  defp link(name, depth) do
    parts = [inertial(name), visual(name), collisions(name)]
    joints = for n <- 1..branches(depth)//1, do: joint("#{name}_#{n}", depth - 1)
    {sources, expected} = Enum.unzip(parts ++ joints)
    {"link :#{name} do\n#{Enum.join(sources, "\n")}\nend", Enum.concat(expected)}
  end

  defp branches(1), do: 0
  defp branches(_depth), do: :rand.uniform(3) - 1

  defp inertial(name) do
    maybe(fn ->
      {mass, kg} = quantity(@mass)
      {origin, {position, _}} = origin()

      {fields, values} =
        Enum.unzip(
          for field <- ~w(ixx iyy izz ixy ixz iyz)a,
              {text, si} = quantity(@inertia),
              do: {"#{field} #{text}", {field, si}}
        )

      {"inertial do\nmass #{mass}\n#{origin}\ninertia do\n#{Enum.join(fields, "\n")}\nend\nend",
       [
         {[:links, :"#{name}", :mass], kg},
         {[:links, :"#{name}", :center_of_mass], position},
         {[:links, :"#{name}", :inertia], Map.new(values)}
       ]}
    end)
  end

  defp visual(name) do
    maybe(fn ->
      {geometry, shape} = geometry()
      {origin, place} = origin()
      [r, g, b] = for _ <- 1..3, do: Float.round(:rand.uniform(), 3)
      color = "color red: #{r}, green: #{g}, blue: #{b}"

      {"visual do\n#{geometry}\n#{origin}\nmaterial :#{name}_m do\n#{color}\nend\nend",
       [
         {[:links, :"#{name}", :visual, :geometry], shape},
         {[:links, :"#{name}", :visual, :origin], place},
         {[:links, :"#{name}", :visual, :material],
          %{name: :"#{name}_m", color: %{red: r, green: g, blue: b, alpha: 1}, texture: nil}}
       ]}
    end)
  end

  defp collisions(name) do
    {sources, shapes} =
      Enum.unzip(
        for n <- 1..(:rand.uniform(3) - 1)//1 do
          {geometry, shape} = geometry()
          {origin, place} = origin()

          {"collision :#{name}_c#{n} do\n#{origin}\n#{geometry}\nend",
           %{name: :"#{name}_c#{n}", origin: place, geometry: shape}}
        end
      )

    {Enum.join(sources, "\n"), [{[:links, :"#{name}", :collisions], shapes}]}
  end

  defp geometry do
    case Enum.random([:box, :cylinder, :sphere, :capsule, :mesh]) do
      :box -> shape(:box, x: :x, y: :y, z: :z)
      :cylinder -> shape(:cylinder, radius: :radius, height: :height)
      :sphere -> shape(:sphere, radius: :radius)
      :capsule -> shape(:capsule, radius: :radius, height: :length)
      :mesh -> {"mesh filename: \"a.stl\"", {:mesh, %{filename: "a.stl", scale: 1}}}
    end
  end

  defp shape(kind, fields) do
    {texts, values} =
      Enum.unzip(
        for {field, key} <- fields,
            {text, si} = quantity(@length),
            do: {"#{field}: #{text}", {key, si}}
      )

    {"#{kind} #{Enum.join(texts, ", ")}", {kind, Map.new(values)}}
  end

  # Fields that are not written are zero.
  defp origin do
    fields = for field <- ~w(x y z)a, do: {field, maybe_quantity(@length)}
    angles = for field <- ~w(roll pitch yaw)a, do: {field, maybe_quantity(@angle)}
    texts = for {field, {text, _si}} <- fields ++ angles, text, do: "#{field} #{text}"

    triple = fn list ->
      list |> Enum.map(fn {_field, {_text, si}} -> si end) |> List.to_tuple()
    end

    {"origin do\n#{Enum.join(texts, "\n")}\nend", {triple.(fields), triple.(angles)}}
  end

  defp maybe_quantity(units),
    do: if(:rand.uniform(2) == 1, do: quantity(units), else: {nil, 0.0})

  defp joint(name, depth) do
    type = Enum.random(@types)
    {origin, {position, orientation}} = origin()
    {limit, limits} = limit(type)
    {dynamics, resistance} = dynamics(type)
    {axis, direction} = axis(type)
    {child, expected} = link("#{name}_link", depth)

    {"joint :#{name} do\ntype #{inspect(type)}\n#{origin}\n#{limit}\n#{dynamics}\n#{axis}\n" <>
       "#{child}\nend",
     [
       {[:joints, :"#{name}", :type], type},
       {[:joints, :"#{name}", :origin], %{position: position, orientation: orientation}},
       {[:joints, :"#{name}", :limits], limits},
       {[:joints, :"#{name}", :dynamics], resistance},
       {[:joints, :"#{name}", :axis], direction},
       {[:joints, :"#{name}", :child_link], :"#{name}_link"} | expected
     ]}
  end

  defp limit(type) when type in [:fixed, :floating], do: {"", nil}

  defp limit(type) do
    units = units(type)
    {effort, effort_si} = quantity(units.effort)
    {velocity, velocity_si} = quantity(units.velocity)
    {acceleration, acceleration_si} = quantity(units.acceleration)
    fields = "effort: #{effort}, velocity: #{velocity}, acceleration: #{acceleration}"

    {ends, lower, upper} =
      if type in [:revolute, :prismatic] do
        unit = Enum.random(units.position)
        [a, b] = Enum.sort(for _ <- 1..2, do: any_number())
        {"lower: ~u(#{a} #{unit}), upper: ~u(#{b} #{unit}), ", si(a, unit), si(b, unit)}
      else
        {"", nil, nil}
      end

    {"limit #{ends}#{fields}",
     %{
       lower: lower,
       upper: upper,
       effort: effort_si,
       velocity: velocity_si,
       acceleration: acceleration_si
     }}
  end

  defp dynamics(type) when type in [:fixed, :floating], do: {"", nil}

  defp dynamics(type) do
    units = units(type)
    {damping, damping_si} = quantity(units.damping)
    {friction, friction_si} = quantity(units.friction)

    {"dynamics do\ndamping #{damping}\nfriction #{friction}\nend",
     %{damping: damping_si, friction: friction_si}}
  end

  defp axis(type) when type in [:fixed, :floating], do: {"", nil}

  defp axis(_type) do
    {roll, r} = quantity(@angle)
    {pitch, p} = quantity(@angle)

    # Rx(roll)·Ry(pitch) turns z into this.
    {"axis roll: #{roll}, pitch: #{pitch}",
     {:math.sin(p), -:math.sin(r) * :math.cos(p), :math.cos(r) * :math.cos(p)}}
  end

  defp units(type) when type in [:revolute, :continuous], do: @turning
  defp units(_type), do: @sliding

  defp maybe(fun), do: if(:rand.uniform(2) == 1, do: fun.(), else: {"", []})

  defp quantity(units) do
    {value, unit} = {any_number(), Enum.random(units)}
    {"~u(#{value} #{unit})", si(value, unit)}
  end

  defp any_number, do: Enum.random([:rand.uniform(100), Float.round(:rand.uniform() * 10, 3)])
  defp si(value, unit), do: value |> Unit.new!(unit) |> Unit.to_si()

  defp assert_same(given, expected, keys, source) do
    assert close?(given, expected),
           "#{inspect(keys)} is #{inspect(given)}, expected #{inspect(expected)} of\n#{source}"
  end

  defp close?(a, b) when is_float(a) and is_float(b), do: abs(a - b) < 1.0e-9

  defp close?(a, b) when is_tuple(a) and is_tuple(b),
    do: close?(Tuple.to_list(a), Tuple.to_list(b))

  defp close?(a, b) when is_list(a) and is_list(b),
    do: length(a) == length(b) and Enum.all?(Enum.zip(a, b), fn {x, y} -> close?(x, y) end)

  defp close?(a, b) when is_map(a) and is_map(b),
    do: Map.keys(a) == Map.keys(b) and Enum.all?(a, fn {key, x} -> close?(x, b[key]) end)

  defp close?(a, b), do: a == b
end

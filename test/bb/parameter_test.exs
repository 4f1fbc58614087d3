defmodule BB.ParameterTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Unit, only: :sigils
  import ExUnit.CaptureLog

  alias BB.Options
  alias BB.Options.ValidationError
  alias BB.Parameter
  alias BB.Parameter.Changed
  alias BB.Test.FlakyStore

  doctest BB.Parameter

  defp tunable do
    robot do
      settings do
        parameter_store BB.Test.FlakyStore
      end

      parameters do
        param :debug, type: :boolean, default: false, doc: "Whether to say more."

        group :imu do
          param :rate,
            type: {:unit, :hertz},
            default: ~u(100 hertz),
            min: ~u(1 hertz),
            max: ~u(1 kilohertz)

          group :filter do
            param :gain, type: :float, default: 0.5, min: 0, max: 1
          end
        end

        param :note, type: :string
      end
    end
  end

  defp start_tunable(opts \\ []) do
    robot = tunable()
    start_supervised!({robot, opts})
    robot
  end

  defmacrop assert_changed(robot, path, changed) do
    quote do
      assert_receive {:bb, [:param | unquote(path)],
                      %BB.Message{
                        robot: ^unquote(robot),
                        frame_id: :parameter,
                        payload: %Changed{path: unquote(path)} = unquote(changed)
                      }}
    end
  end

  describe "get" do
    test "returns {:ok, value} or {:error, :not_found}" do
      robot = start_tunable()
      assert Parameter.get(robot, [:debug]) == {:ok, false}
      assert Parameter.get(robot, [:imu, :rate]) == {:ok, ~u(100 hertz)}
      assert Parameter.get(robot, [:imu, :filter, :gain]) == {:ok, 0.5}
      assert Parameter.get(robot, [:imu]) == {:error, :not_found}
      assert Parameter.get(robot, [:nope]) == {:error, :not_found}
    end

    test "of a parameter without a default is {:error, :not_found} until it is set" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param, :note], replay: true)
      assert Parameter.get(robot, [:note]) == {:error, :not_found}

      assert_raise ArgumentError,
                   ~r/^parameter not found: \[:note\] .* has no value; set it/,
                   fn ->
                     Parameter.get!(robot, [:note])
                   end

      assert Parameter.set(robot, [:note], "x") == :ok
      assert Parameter.get(robot, [:note]) == {:ok, "x"}
      assert_changed(robot, [:note], %{old_value: nil, new_value: "x", source: :local})
      refute_received {:bb, [:param, :note], _}
    end

    test "of a parameter that is set to nil is {:ok, nil}" do
      robot =
        robot do
          parameters do
            param :pin, type: {:or, [:non_neg_integer, nil]}
          end
        end

      start_supervised!(robot)
      assert Parameter.get(robot, [:pin]) == {:error, :not_found}
      assert Parameter.set(robot, [:pin], 17) == :ok
      assert Parameter.set(robot, [:pin], nil) == :ok
      assert Parameter.get(robot, [:pin]) == {:ok, nil}
      assert [{[:pin], %{value: nil, type: {:or, _}}}] = Parameter.list(robot)
    end

    test "reads ETS, no process" do
      robot = start_tunable()
      for name <- [Parameters, ParameterOwner], do: suspend(robot, name)
      assert Parameter.get(robot, [:debug]) == {:ok, false}
      assert Parameter.get!(robot, [:debug]) == false
      assert [_ | _] = Parameter.list(robot)
      for name <- [Parameters, ParameterOwner], do: :sys.resume(Module.concat(robot, name))
    end

    defp suspend(robot, name), do: :sys.suspend(Module.concat(robot, name))

    test "with a ! returns the value or raises" do
      robot = start_tunable()
      assert Parameter.get!(robot, [:debug]) == false

      name = inspect(robot)

      assert_raise ArgumentError,
                   "parameter not found: #{name} has no [:nope]; " <>
                     "BB.Parameter.list(#{name}) returns its parameters",
                   fn -> Parameter.get!(robot, [:nope]) end
    end

    test "raises ArgumentError when the robot is not started, as all functions do" do
      robot = tunable()

      for call <- [
            fn -> Parameter.get(robot, [:debug]) end,
            fn -> Parameter.get!(robot, [:debug]) end,
            fn -> Parameter.list(robot) end,
            fn -> Parameter.set(robot, [:debug], true) end,
            fn -> Parameter.watch(robot, [[:debug]]) end
          ] do
        assert_raise ArgumentError, ~r/^robot .* is not started; start it .*start_link\(\)$/, call
      end
    end
  end

  describe "set" do
    test "returns :ok and changes the value" do
      robot = start_tunable()
      assert Parameter.set(robot, [:debug], true) == :ok
      assert Parameter.get(robot, [:debug]) == {:ok, true}
    end

    test "converts a unit to the parameter's own" do
      robot = start_tunable()
      assert Parameter.set(robot, [:imu, :rate], ~u(0.2 kilohertz)) == :ok
      assert %BB.Unit{name: "hertz", value: value} = Parameter.get!(robot, [:imu, :rate])
      assert_in_delta value, 200, 1.0e-9
    end

    test "of an unknown name in a group is {:error, {:unknown_parameter, name}}" do
      robot = start_tunable()
      assert Parameter.set(robot, [:imu, :rtae], 1) == {:error, {:unknown_parameter, :rtae}}
      assert Parameter.set(robot, [:dbug], 1) == {:error, {:unknown_parameter, :dbug}}
    end

    test "anywhere else is {:error, {:unregistered_parameter, path}}" do
      robot = start_tunable()

      for path <- [[:arm, :gain], [:imu, :rate, :x]],
          do: assert(Parameter.set(robot, path, 1) == {:error, {:unregistered_parameter, path}})
    end

    for {what, how} <- [
          raise: quote(do: raise("shy")),
          throw: quote(do: throw(:shy)),
          kill: quote(do: Process.exit(self(), :kill)),
          hang: quote(do: Process.sleep(:infinity))
        ] do
      test "of a value that cannot be shown (#{what}) hurts the caller alone" do
        robot = start_tunable()
        processes = for {id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid}
        test = self()

        shy = %BB.Test.Mischief.Shy{
          how: fn ->
            send(test, :shown)
            unquote(how)
          end
        }

        caller = spawn(fn -> Parameter.set(robot, [:imu, :filter, :gain], shy) end)
        assert_receive :shown, 30_000
        assert Parameter.set(robot, [:imu, :filter, :gain], 0.25) == :ok
        Process.exit(caller, :kill)

        assert processes ==
                 for({id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid})
      end
    end

    test "of what is no path raises for the caller alone" do
      robot = start_tunable()
      processes = for {id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid}

      for wrong <- [[:debug | :x], [:debug, :x | nil], [], :debug, nil, "debug"] do
        assert_raise ArgumentError, ~r/with a path such as/, fn ->
          Parameter.set(robot, wrong, true)
        end

        assert_raise ArgumentError, ~r/with a path such as/, fn ->
          Parameter.set_many(robot, [{[:debug], true}, {wrong, true}])
        end
      end

      assert Parameter.get!(robot, [:debug]) == false
      assert processes == for({id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid})
    end

    test "of a value that does not fit is {:error, %ValidationError{}} and changes nothing" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])

      for {path, value, message} <- [
            {[:debug], 1, "invalid value for :debug option: expected boolean, got: 1"},
            {[:imu, :rate], ~u(2 kilohertz),
             "invalid value for :rate option: expected value to be at most ~u(1 kilohertz), got: ~u(2000 hertz) (in options [:imu])"},
            {[:imu, :filter, :gain], 1,
             "invalid value for :gain option: expected float, got: 1 (in options [:imu, :filter])"},
            {[:imu, :filter, :gain], -0.1,
             "invalid value for :gain option: expected value to be at least 0, got: -0.1 (in options [:imu, :filter])"}
          ] do
        before = Parameter.get!(robot, path)
        assert {:error, %ValidationError{} = error} = Parameter.set(robot, path, value)
        assert Exception.message(error) == message
        assert Parameter.get!(robot, path) == before
      end

      refute_received {:bb, [:param | _], _}
    end

    test "publishes Changed on [:param | path] with frame_id :parameter, also when the value is the old one" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])
      :ok = Parameter.set(robot, [:debug], true)
      assert_changed(robot, [:debug], %{old_value: false, new_value: true, source: :local})
      :ok = Parameter.set(robot, [:debug], true)
      assert_changed(robot, [:debug], %{old_value: true, new_value: true, source: :local})
    end

    test "is heard by who subscribes late with replay, and so is what a parameter started with" do
      robot = start_tunable(params: [debug: true])
      :ok = Parameter.set(robot, [:imu, :filter, :gain], 0.75)
      {:ok, _} = BB.subscribe(robot, [:param], replay: true)
      assert_changed(robot, [:debug], %{old_value: nil, new_value: true, source: :startup})
      assert_changed(robot, [:imu, :rate], %{new_value: ~u(100 hertz), source: :init})
      assert_changed(robot, [:imu, :filter, :gain], %{old_value: 0.5, new_value: 0.75})
      assert %{payload: %Changed{new_value: true}} = BB.PubSub.last(robot, [:param, :debug])
    end

    test "is visible to get before Changed is published" do
      robot = start_tunable()
      test = self()

      reader =
        spawn_link(fn ->
          {:ok, _} = BB.subscribe(robot, [:param, :imu, :filter, :gain])
          send(test, :ready)
          read(robot, test)
        end)

      assert_receive :ready
      for n <- 1..200, do: :ok = Parameter.set(robot, [:imu, :filter, :gain], n / 200)
      send(reader, :done)
      assert_receive {:stale, []}
    end

    # Values only grow, so one that is read below the one announced is an old one.
    defp read(robot, test, stale \\ []) do
      receive do
        {:bb, _path, %{payload: %{new_value: announced}}} ->
          got = Parameter.get!(robot, [:imu, :filter, :gain])
          read(robot, test, if(got < announced, do: [{got, announced} | stale], else: stale))

        :done ->
          send(test, {:stale, stale})
      end
    end
  end

  describe "set_many" do
    test "sets all" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])
      assert Parameter.set_many(robot, [{[:debug], true}, {[:imu, :filter, :gain], 1.0}]) == :ok
      assert Parameter.get!(robot, [:debug])
      assert Parameter.get!(robot, [:imu, :filter, :gain]) == 1.0
      assert_changed(robot, [:debug], %{source: :local})
      assert_changed(robot, [:imu, :filter, :gain], %{old_value: 0.5, new_value: 1.0})
    end

    test "or nothing, and returns {:error, [{path, reason}]} for all that are wrong" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])

      assert {:error,
              [{[:imu, :rate], %ValidationError{}}, {[:imu, :x], {:unknown_parameter, :x}}]} =
               Parameter.set_many(robot, [{[:debug], true}, {[:imu, :rate], 1}, {[:imu, :x], 1}])

      assert Parameter.get!(robot, [:debug]) == false
      refute_received {:bb, [:param | _], _}
      assert FlakyStore.all(robot) == %{}
    end

    test "takes a map too, and raises for what is no path and value" do
      robot = start_tunable()
      assert Parameter.set_many(robot, %{[:debug] => true}) == :ok

      assert_raise ArgumentError, ~r/expected {path, value}/, fn ->
        Parameter.set_many(robot, debug: true)
      end

      assert_raise ArgumentError, fn -> Parameter.set(robot, [], true) end
    end

    test "is one moment for those who watch" do
      robot = start_tunable()
      gain = [:imu, :filter, :gain]
      assert {:ok, ref, values} = Parameter.watch(robot, [[:debug], gain])
      assert values == %{[:debug] => false, gain => 0.5}
      :ok = Parameter.set_many(robot, [{[:debug], true}, {gain, 1.0}, {[:note], "x"}])
      :ok = Parameter.set(robot, [:note], "y")
      :ok = Parameter.set(robot, gain, 0.0)
      assert_receive {Parameter, ^ref, %{[:debug] => true, ^gain => 1.0} = both}
      assert map_size(both) == 2
      assert_receive {Parameter, ^ref, %{^gain => value}} when value == 0.0
      refute_received {Parameter, ^ref, _}

      assert Parameter.watch(robot, [[:nope]]) == {:error, {:unregistered_parameter, [:nope]}}
    end
  end

  describe "list" do
    test "returns [{path, %{value, type, min, max, doc, default}}] below a prefix" do
      robot = start_tunable()
      :ok = Parameter.set(robot, [:imu, :rate], ~u(50 hertz))

      assert Parameter.list(robot, prefix: [:imu]) == [
               {[:imu, :filter, :gain],
                %{value: 0.5, type: :float, min: 0, max: 1, doc: nil, default: 0.5}},
               {[:imu, :rate],
                %{
                  value: ~u(50 hertz),
                  type: {:unit, :hertz},
                  min: ~u(1 hertz),
                  max: ~u(1 kilohertz),
                  doc: nil,
                  default: ~u(100 hertz)
                }}
             ]

      assert [{[:debug], %{doc: "Whether to say more."}}] =
               Parameter.list(robot, prefix: [:debug])

      assert Parameter.list(robot, prefix: [:nope]) == []

      assert for({path, _} <- Parameter.list(robot), do: path) ==
               [[:debug], [:imu, :filter, :gain], [:imu, :rate]]

      :ok = Parameter.set(robot, [:note], "x")

      assert {[:note], %{value: "x", type: :string, default: nil}} =
               List.last(Parameter.list(robot))
    end
  end

  defmodule Arm do
    @behaviour BB.Parameter
    @impl BB.Parameter
    def param_schema, do: [gain: [type: :float, default: 1.0, max: 2.0], name: [type: :atom]]
  end

  defmodule WrongArm do
    def param_schema, do: [gain: [type: :float, default: 1]]
  end

  describe "register" do
    test "adds the parameters of a module below a path" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])

      assert Parameter.set(robot, [:arm, :gain], 1.5) ==
               {:error, {:unregistered_parameter, [:arm, :gain]}}

      assert Parameter.register(robot, [:arm], Arm) == :ok
      assert_changed(robot, [:arm, :gain], %{old_value: nil, new_value: 1.0, source: :init})
      assert Parameter.get(robot, [:arm, :gain]) == {:ok, 1.0}
      assert Parameter.set(robot, [:arm, :gain], 1.5) == :ok
      assert {:error, %ValidationError{}} = Parameter.set(robot, [:arm, :gain], 2.5)
      assert Parameter.set(robot, [:arm, :gian], 1.5) == {:error, {:unknown_parameter, :gian}}
    end

    test "again keeps the values" do
      robot = start_tunable()
      :ok = Parameter.register(robot, [:arm], Arm)
      :ok = Parameter.set(robot, [:arm, :gain], 1.5)
      assert Parameter.register(robot, [:arm], Arm) == :ok
      assert Parameter.get(robot, [:arm, :gain]) == {:ok, 1.5}
    end

    test "takes persisted values" do
      robot = tunable()
      FlakyStore.put(robot, [:arm, :gain], 0.25)
      start_supervised!(robot)
      :ok = Parameter.register(robot, [:arm], Arm)
      assert Parameter.get(robot, [:arm, :gain]) == {:ok, 0.25}
    end

    test "over a parameter of another origin is {:error, {:already_registered, path}}" do
      robot = start_tunable()
      :ok = Parameter.register(robot, [:arm], Arm)

      for path <- [[:debug], [:arm, :gain]],
          do:
            assert(Parameter.register(robot, path, Arm) == {:error, {:already_registered, path}})

      assert Parameter.get(robot, [:debug]) == {:ok, false}
    end

    test "of a module without a schema is an error, of one with a wrong schema raises" do
      robot = start_tunable()

      for module <- [String, NoModule, :no_module] do
        refute Parameter.implements?(module)

        assert Parameter.register(robot, [:a], module) ==
                 {:error, {:not_a_parameter_component, module}}
      end

      refute Parameter.implements?("no module")
      assert Parameter.implements?(Arm)

      assert_raise ArgumentError,
                   "parameter [:a, :gain]: invalid `default`: expected float, got: 1",
                   fn -> Parameter.register(robot, [:a], WrongArm) end

      for schema <- [[*: [type: :float]], [:gain], 1] do
        :persistent_term.put({__MODULE__, robot}, schema)

        assert_raise ArgumentError, ~r/schema.*got: /s, fn ->
          Parameter.register(robot, [:a], schema_module(robot))
        end
      end

      assert Parameter.list(robot, prefix: [:a]) == []
    end

    # A module whose schema the test changes.
    defp schema_module(robot) do
      module = Module.concat(robot, Component)

      unless Code.ensure_loaded?(module) do
        body =
          quote(
            do: def(param_schema, do: :persistent_term.get({unquote(__MODULE__), unquote(robot)}))
          )

        Module.create(module, body, Macro.Env.location(__ENV__))
      end

      module
    end

    defp register(robot, path, schema) do
      :persistent_term.put({__MODULE__, robot}, schema)
      Parameter.register(robot, path, schema_module(robot))
    end

    test "takes a %BB.Options{} with every key and type of an options schema" do
      robot = start_tunable()
      {:ok, _} = BB.subscribe(robot, [:param])

      schema =
        Options.new!(
          gain: [type: :float, required: true, doc: "The gain.", type_doc: "a float"],
          kind: [type: {:in, [:slow, :fast]}, default: :slow],
          limit: [type: {:or, [:pos_integer, {:literal, :infinity}]}, default: :infinity],
          count: [type: :pos_integer, default: 1, doc: false],
          open: [],
          even: [type: {:custom, BB.Dsl.ParametersTest, :even, []}, default: 2],
          filter: [
            type: :keyword_list,
            default: [],
            keys: [size: [type: :integer, default: 3]]
          ]
        )

      assert register(robot, [:arm], schema) == :ok

      assert for(
               {path, %{value: value}} <- Parameter.list(robot, prefix: [:arm]),
               do: {path, value}
             ) ==
               [
                 {[:arm, :count], 1},
                 {[:arm, :even], 2},
                 {[:arm, :filter], [size: 3]},
                 {[:arm, :kind], :slow},
                 {[:arm, :limit], :infinity}
               ]

      assert_changed(robot, [:arm, :kind], %{old_value: nil, new_value: :slow, source: :init})
      assert_changed(robot, [:arm, :count], %{old_value: nil, new_value: 1, source: :init})
      refute_received {:bb, [:param, :arm, :gain], _}
      assert Parameter.get(robot, [:arm, :gain]) == {:error, :not_found}
      assert Parameter.set(robot, [:arm, :gain], 0.5) == :ok
      assert_changed(robot, [:arm, :gain], %{old_value: nil, new_value: 0.5, source: :local})

      assert [{[:arm, :gain], %{type: :float, doc: "The gain.", default: nil, value: 0.5}}] =
               Parameter.list(robot, prefix: [:arm, :gain])

      for {name, good, bad} <- [
            {:gain, 1.0, 1},
            {:kind, :fast, :medium},
            {:limit, 3, 0},
            {:open, {:any, "term"}, nil},
            {:even, 4, 3},
            {:filter, [size: 1], [size: 1.0]}
          ] do
        assert Parameter.set(robot, [:arm, name], good) == :ok
        assert Parameter.get(robot, [:arm, name]) == {:ok, good}
        if bad, do: assert({:error, %ValidationError{}} = Parameter.set(robot, [:arm, name], bad))
      end

      assert {:error, error} = Parameter.set(robot, [:arm, :filter], size: 1.0)

      assert Exception.message(error) ==
               "invalid value for :size option: expected integer, got: 1.0 (in options [:arm, :filter])"

      assert Parameter.set(robot, [:arm, :x], 1) == {:error, {:unknown_parameter, :x}}
    end

    test "lists a unit of BB.Unit.Option as a unit with its bounds, and converts to it" do
      robot = start_tunable()

      type =
        BB.Unit.Option.unit_type(compatible: :degree, min: ~u(-90 degree), max: ~u(90 degree))

      schema = Options.new!(angle: [type: type, default: ~u(0 radian), doc: "The angle."])
      assert register(robot, [:arm], schema) == :ok

      assert [{[:arm, :angle], angle}] = Parameter.list(robot, prefix: [:arm])

      assert %{type: {:unit, :degree}, min: ~u(-90 degree), max: ~u(90 degree)} = angle
      assert %{value: %BB.Unit{name: "degree"}, doc: "The angle."} = angle
      {:ok, _} = BB.subscribe(robot, [:param, :arm])
      assert Parameter.set(robot, [:arm, :angle], ~u(0.26 radian)) == :ok
      assert %BB.Unit{name: "degree", value: value} = Parameter.get!(robot, [:arm, :angle])
      assert_in_delta value, 14.8969, 0.0001
      assert_changed(robot, [:arm, :angle], %{new_value: %BB.Unit{name: "degree"}})
      assert {:error, error} = Parameter.set(robot, [:arm, :angle], ~u(2 radian))
      assert Exception.message(error) =~ "expected value to be at most ~u(90 degree), got: "
    end

    test "takes a %Spark.Options{}" do
      robot = start_tunable()
      schema = %{__struct__: Spark.Options, schema: [gain: [type: :float, default: 1.0]]}
      assert register(robot, [:arm], schema) == :ok
      assert Parameter.get(robot, [:arm, :gain]) == {:ok, 1.0}
    end

    test "again with other definitions drops the values that do not fit any more" do
      robot = start_tunable()
      schema = &Options.new!(gain: [type: &1], name: [type: :atom, default: :arm])
      assert register(robot, [:arm], schema.(:float)) == :ok
      assert Parameter.set(robot, [:arm, :gain], 1.5) == :ok
      assert Parameter.set(robot, [:arm, :name], :leg) == :ok
      assert register(robot, [:arm], schema.(:integer)) == :ok
      assert Parameter.get(robot, [:arm, :gain]) == {:error, :not_found}
      assert Parameter.get(robot, [:arm, :name]) == {:ok, :leg}
      assert Parameter.set(robot, [:arm, :gain], 1) == :ok
    end

    test "while others set: each value is judged by the definition that holds" do
      robot = start_tunable()
      schema = &Options.new!(gain: [type: &1])
      :ok = register(robot, [:arm], schema.(:float))

      setters =
        for value <- [1, 1.0] do
          Task.async(fn -> for _ <- 1..200, do: Parameter.set(robot, [:arm, :gain], value) end)
        end

      for n <- 1..50 do
        type = if rem(n, 2) == 0, do: :float, else: :integer
        :ok = register(robot, [:arm], schema.(type))

        case Parameter.get(robot, [:arm, :gain]) do
          {:ok, gain} -> assert is_float(gain) == (type == :float)
          {:error, :not_found} -> :ok
        end
      end

      results = setters |> Task.await_many(60_000) |> List.flatten()
      assert Enum.all?(results, &(&1 == :ok or match?({:error, %ValidationError{}}, &1)))
    end
  end

  describe "a type with a function of others" do
    test "that fails refuses the value, and harms nobody" do
      robot =
        robot do
          parameters do
            param :guarded, type: {:custom, BB.ParameterTest, :guard, []}, default: 1
          end
        end

      start_supervised!(robot)
      processes = for {id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid}

      for {value, reason} <- [
            {:raise, "raised RuntimeError: no"},
            {:throw, "threw :no"},
            {:exit, "exited with :no"},
            {:hang, "did not return within 1000 ms"},
            {:wrong, "must return {:ok, value} or {:error, message}, got: :no"}
          ] do
        assert {:error, %ValidationError{} = error} = Parameter.set(robot, [:guarded], value)
        assert error.message =~ "invalid value for :guarded option: the check of its type "
        assert error.message =~ reason
        assert Parameter.get(robot, [:guarded]) == {:ok, 1}
      end

      assert processes == for({id, pid, _, _} <- Supervisor.which_children(robot), do: {id, pid})
      assert {:error, %ValidationError{}} = robot.start_link(params: [guarded: :raise])
    end
  end

  def guard(value) when is_integer(value), do: {:ok, value}
  def guard(:raise), do: raise("no")
  def guard(:throw), do: throw(:no)
  def guard(:exit), do: exit(:no)
  def guard(:hang), do: Process.sleep(:infinity)
  def guard(:wrong), do: :no

  describe "a remote parameter" do
    defmodule Bridge do
      @moduledoc false
      use BB.Controller

      @impl BB.Controller
      def init(_opts), do: {:ok, %{"1:gain" => 0.5}}

      @impl BB.Controller
      def handle_call(:list_remote, _from, values) do
        listed =
          for {id, value} <- values,
              do: %{id: id, value: value, type: :float, doc: nil, path: [:gain]}

        {:reply, {:ok, listed}, values}
      end

      def handle_call({:get_remote, id}, _from, values),
        do: {:reply, with(:error <- Map.fetch(values, id), do: {:error, :unknown}), values}

      def handle_call({:set_remote, id, value}, _from, values),
        do: {:reply, :ok, Map.put(values, id, value)}

      def handle_call({:subscribe_remote, "1:gain"}, _from, values), do: {:reply, :ok, values}
    end

    test "is listed, read, set and followed by calls of its bridge" do
      robot =
        robot do
          controllers do
            controller :servos, BB.ParameterTest.Bridge
          end
        end

      start_supervised!(robot)
      await_all_up(robot)
      remote = %{id: "1:gain", value: 0.5, type: :float, doc: nil, path: [:gain]}
      assert Parameter.list_remote(robot, :servos) == {:ok, [remote]}
      assert Parameter.get_remote(robot, :servos, "1:gain") == {:ok, 0.5}
      assert Parameter.set_remote(robot, :servos, "1:gain", 0.75) == :ok
      assert Parameter.get_remote(robot, :servos, "1:gain") == {:ok, 0.75}
      assert Parameter.get_remote(robot, :servos, "2:gain") == {:error, :unknown}
      assert Parameter.subscribe_remote(robot, :servos, "1:gain") == :ok
      assert {:noproc, _} = catch_exit(Parameter.list_remote(robot, :nobody))
    end
  end

  describe "a reference to a parameter without a value" do
    test "resolves to nil, and to its value once that is set" do
      robot = start_tunable()
      note = BB.Parameter.Reference.param([:note])
      assert Parameter.resolve(robot, note: note) == [note: nil]
      assert {:ok, ref, %{[:note] => nil}} = Parameter.watch(robot, [[:note]])
      :ok = Parameter.set(robot, [:note], "x")
      assert_receive {Parameter, ^ref, %{[:note] => "x"}}
      assert Parameter.resolve(robot, note: note) == [note: "x"]

      assert_raise ArgumentError, ~r/parameter not found/, fn ->
        Parameter.resolve(robot, note: BB.Parameter.Reference.param([:nope]))
      end
    end
  end

  describe "at the start" do
    test "the DSL's default gives way to the persisted value, and that to start_link(params: nested_kw)" do
      robot = tunable()
      FlakyStore.put(robot, [:imu, :rate], ~u(20 hertz))
      FlakyStore.put(robot, [:imu, :filter, :gain], 0.25)
      start_supervised!({robot, params: [imu: [filter: [gain: 0.75]]]})
      assert Parameter.get!(robot, [:debug]) == false
      assert Parameter.get!(robot, [:imu, :rate]) == ~u(20 hertz)
      assert Parameter.get!(robot, [:imu, :filter, :gain]) == 0.75
    end

    test "values are unit-converted" do
      robot = tunable()
      FlakyStore.put(robot, [:imu, :rate], ~u(1 kilohertz))
      start_supervised!(robot)
      assert Parameter.get!(robot, [:imu, :rate]) == ~u(1000 hertz)
      stop_supervised!(robot)
      start_supervised!({robot, params: [imu: [rate: ~u(1 kilohertz)]]})
      assert Parameter.get!(robot, [:imu, :rate]) == ~u(1000 hertz)
    end

    test "a bad startup value fails the start" do
      robot = tunable()

      for {params, message} <- [
            {[debug: 1],
             "invalid value for :debug option: expected boolean, got: 1 (in options [:params])"},
            {[imu: [rate: ~u(0 hertz)]],
             "invalid value for :rate option: expected value to be at least ~u(1 hertz), got: ~u(0 hertz) (in options [:params, :imu])"},
            {[imu: [rtae: ~u(1 hertz)]],
             "unknown options [:rtae], valid options are: [:filter, :rate] (in options [:params, :imu])"},
            {[imu: 1],
             "invalid value for :imu option: expected keyword list, got: 1 (in options [:params])"},
            {1, "invalid value for :params option: expected keyword list, got: 1"}
          ] do
        assert {:error, %ValidationError{} = error} = robot.start_link(params: params)
        assert Exception.message(error) == message
        assert Process.whereis(robot) == nil
      end
    end

    test "a bad persisted value is logged and dropped, never a boot loop" do
      robot = tunable()
      FlakyStore.put(robot, [:imu, :rate], ~u(9 kilohertz))
      FlakyStore.put(robot, [:imu, :filter, :gain], %{__struct__: Gone, x: 1})
      FlakyStore.put(robot, [:debug], true)
      FlakyStore.put(robot, [:nobody, :knows], 1)

      log = capture_log(fn -> start_supervised!(robot) end)
      assert log =~ "the persisted value of parameter [:imu, :rate] is dropped: "
      assert log =~ "expected value to be at most ~u(1 kilohertz), got: ~u(9000 hertz)"
      assert log =~ "the persisted value of parameter [:imu, :filter, :gain] is dropped: "
      assert Parameter.get!(robot, [:imu, :rate]) == ~u(100 hertz)
      assert Parameter.get!(robot, [:imu, :filter, :gain]) == 0.5
      assert Parameter.get!(robot, [:debug]) == true
    end
  end

  describe "what is set" do
    test "is there when the robot is started again; startup values and defaults are not kept" do
      robot = tunable()
      start_supervised!({robot, params: [debug: true]})
      :ok = Parameter.set(robot, [:imu, :rate], ~u(7 hertz))
      stop_supervised!(robot)
      assert FlakyStore.all(robot) == %{[:imu, :rate] => ~u(7 hertz)}
      start_supervised!(robot)
      assert Parameter.get!(robot, [:imu, :rate]) == ~u(7 hertz)
      assert Parameter.get!(robot, [:debug]) == false
    end

    test "outlives a crash of what writes it, and those who watch hear on" do
      robot = start_tunable()
      :ok = Parameter.set(robot, [:debug], true)
      {:ok, ref, _} = Parameter.watch(robot, [[:debug]])
      owner = Process.whereis(Module.concat(robot, ParameterOwner))
      Process.exit(owner, :kill)

      assert eventually(fn ->
               Process.whereis(Module.concat(robot, ParameterOwner)) not in [nil, owner]
             end)

      assert Parameter.get!(robot, [:debug]) == true
      :ok = Parameter.set(robot, [:debug], false)
      assert_receive {Parameter, ^ref, %{[:debug] => false}}
    end

    test "and persisted outlives a crash of all that keeps it, which ends the watches" do
      robot = start_tunable()
      :ok = Parameter.set(robot, [:debug], true)
      {:ok, ref, _} = Parameter.watch(robot, [[:debug]])
      Process.exit(Process.whereis(Module.concat(robot, Parameters)), :kill)
      assert_receive {:DOWN, ^ref, :process, _, :killed}
      assert eventually(fn -> persisted?(robot) end)
    end

    defp persisted?(robot) do
      Parameter.get(robot, [:debug]) == {:ok, true}
    rescue
      ArgumentError -> false
    end
  end

  describe "a store that fails" do
    for {callback, verb} <- [init: "open", load: "load", save: "save [:debug] in"] do
      test "to #{verb} costs a warning, and set says what it did not keep" do
        robot = tunable()
        FlakyStore.script(robot, [{unquote(callback), fn -> {:error, :enospc} end}])

        log =
          capture_log(fn ->
            start_supervised!(robot)
            assert Parameter.set(robot, [:debug], true) == {:error, {:not_kept, :enospc}}

            assert Parameter.set_many(robot, [{[:debug], true}, {[:note], "x"}]) ==
                     {:error, {:not_kept, :enospc}}
          end)

        assert log =~ "[warning] #{inspect(robot)}: cannot #{unquote(verb)} the parameter store "
        assert log =~ "BB.Test.FlakyStore: no space left on device (enospc)"
        assert Parameter.get(robot, [:debug]) == {:ok, true}
        assert Parameter.get(robot, [:note]) == {:ok, "x"}
      end
    end
  end

  # Parameters against a plain map

  @model %{
    [:debug] => {false, [true, false], [1, nil, "true"]},
    [:imu, :rate] =>
      {~u(100 hertz), [~u(1 hertz), ~u(5 hertz), ~u(1000 hertz)], [~u(0 hertz), ~u(1 meter), 5]},
    [:imu, :filter, :gain] => {0.5, [0.0, 0.25, 1.0], [1, -0.5, 1.5, :high]},
    [:note] => {nil, ["", "x"], [:x, 1]}
  }

  property "any sequence of set, set_many, get, list and restart is that of a plain map",
    numtests: 60 do
    forall commands <- list(command()) do
      robot = tunable()
      {:ok, _} = robot.start_link()
      defaults = Map.new(@model, fn {path, {default, _, _}} -> {path, default} end)
      {model, kept} = {defaults, %{}}

      {robot, _, _, _} =
        Enum.reduce(commands, {robot, model, kept, defaults}, fn command, state ->
          {robot, model, _kept, _} = state = run(command, state)
          for {path, value} <- model, do: assert(Parameter.get(robot, path) == got(value))
          state
        end)

      Supervisor.stop(robot)
      true
    end
  end

  # Of the model's parameters, none can be set to nil.
  defp got(nil), do: {:error, :not_found}
  defp got(value), do: {:ok, value}

  defp command do
    oneof([
      {:set, change()},
      {:set_many, list(change())},
      {:list, oneof([[], [:imu], [:imu, :filter], [:nope]])},
      :restart,
      {:restart, oneof(Map.keys(@model) -- [[:note]])}
    ])
  end

  defp change do
    known = for {path, {_, good, bad}} <- @model, value <- good ++ good ++ bad, do: {path, value}
    oneof(Enum.map([{[:nope], 1}, {[:imu, :nope, :x], 1} | known], &exactly/1))
  end

  defp run({:set, {path, value}}, {robot, model, kept, defaults}) do
    if good?({path, value}) do
      assert Parameter.set(robot, path, value) == :ok
      {robot, Map.put(model, path, value), Map.put(kept, path, value), defaults}
    else
      assert {:error, _} = Parameter.set(robot, path, value)
      {robot, model, kept, defaults}
    end
  end

  defp run({:set_many, changes}, {robot, model, kept, defaults}) do
    case Enum.reject(changes, &good?/1) do
      [] ->
        assert Parameter.set_many(robot, changes) == :ok
        {robot, Enum.into(changes, model), Enum.into(changes, kept), defaults}

      bad ->
        assert {:error, errors} = Parameter.set_many(robot, changes)
        assert Enum.map(errors, &elem(&1, 0)) == Enum.map(bad, &elem(&1, 0))
        {robot, model, kept, defaults}
    end
  end

  defp run({:list, prefix}, {robot, model, _, _} = state) do
    listed =
      for {path, %{value: value}} <- Parameter.list(robot, prefix: prefix), do: {path, value}

    in_model = for {p, v} <- model, v != nil, List.starts_with?(p, prefix), do: {p, v}
    assert listed == Enum.sort(in_model)
    state
  end

  defp run(:restart, state), do: restart(state, [])
  defp run({:restart, path}, state), do: restart(state, [{path, startup(path)}])

  defp restart({robot, _model, kept, defaults}, startup) do
    Supervisor.stop(robot)
    {:ok, _} = robot.start_link(params: Enum.reduce(startup, [], &nest/2))
    {robot, defaults |> Map.merge(kept) |> Map.merge(Map.new(startup)), kept, defaults}
  end

  defp startup(path), do: @model |> Map.fetch!(path) |> elem(1) |> List.last()
  defp nest({[name], value}, into), do: [{name, value} | into]
  defp nest({[name | path], value}, into), do: [{name, nest({path, value}, [])} | into]

  defp good?({path, value}) do
    case @model do
      %{^path => {_, good, _}} -> value in good
      _ -> false
    end
  end
end

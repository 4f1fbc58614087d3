defmodule BB.Dsl.FunctionsTest do
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false

  import ExUnit.CaptureIO

  defmodule Lifted do
    use BB

    @limit 10.5

    controllers do
      controller :low, {
        BB.Controller.PatternMatch,
        topic: [:sensor],
        match: fn
          %{payload: %{voltage: voltage}} when voltage < @limit -> true
          _message -> false
        end,
        action: handle_event(fn message, _context -> double(message) end)
      }

      controller(
        :high,
        {BB.Controller.PatternMatch,
         topic: [:sensor], match: &(&1.payload.voltage > @limit), action: handle_event(&{&2, &1})}
      )

      for name <- [:one, :two] do
        controller name,
                   {BB.Controller.PatternMatch,
                    topic: [:sensor],
                    match: &high?/1,
                    action: handle_event(&Map.fetch/2),
                    cooldown_ms: Enum.sum(Enum.map(1..3, fn n -> n * 10 end))}
      end
    end

    defp double(number), do: number * 2

    defp high?(message), do: message.payload.voltage > @limit
  end

  setup do
    controllers = BB.Dsl.Info.controllers(Lifted)
    options = for %{name: name, child_spec: {_module, opts}} <- controllers, do: {name, opts}
    %{options: options, low: %{payload: %{voltage: 9.0}}, high: %{payload: %{voltage: 11.0}}}
  end

  test "an anonymous function has its clauses, attributes and private functions", context do
    low = context.options[:low]
    assert low[:match].(context.low)
    refute low[:match].(context.high)
    assert low[:match].(:other) == false
    assert low[:action].handler.(21, %{}) == 42
  end

  test "a capture has its arguments in order", context do
    high = context.options[:high]
    assert high[:match].(context.high)
    refute high[:match].(context.low)
    assert high[:action].handler.(1, 2) == {2, 1}
  end

  test "a capture in a loop is of a private function, and one of a remote one remains", context do
    for name <- [:one, :two] do
      assert context.options[name][:match].(context.high)
      refute context.options[name][:match].(context.low)
      assert context.options[name][:action].handler == (&Map.fetch/2)
    end
  end

  test "a function that the options call themselves remains", context do
    assert context.options[:one][:cooldown_ms] == 60
  end

  test "a robot with them starts" do
    start_supervised!(Lifted)
    up? = fn -> Enum.all?(BB.Controller.health(Lifted), &(&1.state == :up)) end
    assert BB.Test.Eventually.eventually(up?)
  end

  test "options with functions are checked as others are" do
    assert compile("fn _message -> true end") == ""

    assert compile("fn _message, _context -> true end") =~
             "wrong options for BB.Controller.PatternMatch"
  end

  defp compile(match) do
    controller =
      "{BB.Controller.PatternMatch, topic: [], match: #{match}, action: command(:home)}"

    name = "BB.Dsl.FunctionsTest.Checked#{System.unique_integer([:positive])}"
    code = "defmodule #{name} do use BB\n controllers do controller :c, #{controller}\n end end"
    capture_io(:stderr, fn -> Code.compile_string(code) end)
  end
end

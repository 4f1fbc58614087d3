defmodule BB.Test.Prop do
  @moduledoc """
  Properties with PropEr in ExUnit.

      defmodule MyTest do
        use ExUnit.Case, async: true
        use BB.Test.Prop

        property "reversing twice changes nothing" do
          forall xs <- list(integer()), do: Enum.reverse(Enum.reverse(xs)) == xs
        end
      end

  `use` imports `property/2,3`, `forall/2`, the generators below and PropEr's own (`list/1`,
  `vector/2`, `oneof/1`, `integer/0,2`, `float/0,2`, `boolean/0`, `binary/0`, `tuple/1`,
  `frequency/1`, …; others by their full name, `:proper_types.resize/2`).

    * `property name, numtests: 500 do … end` runs that many cases (default 100).
      `max_shrinks: 50` limits the search for a smaller failure (default 500).
    * `forall pattern <- generator, do: body` holds if the body is true. An exception, also of
      `assert`, is a counterexample. Several generators: `forall {a, b} <- {integer(), atom()}`;
      foralls nest.
    * `bind(generator, fn value -> generator end)` makes a generator from another's value,
      `map(generator, fun)` transforms values.

  A property that fails raises `ExUnit.AssertionError` with the smallest counterexample.
  """

  defmacro __using__(_opts) do
    quote do
      import BB.Test.Prop

      import :proper_types,
        only: [
          any: 0,
          binary: 0,
          boolean: 0,
          exactly: 1,
          fixed_list: 1,
          float: 0,
          float: 2,
          frequency: 1,
          integer: 0,
          integer: 2,
          list: 1,
          neg_integer: 0,
          non_empty: 1,
          non_neg_integer: 0,
          number: 0,
          oneof: 1,
          pos_integer: 0,
          sized: 1,
          tuple: 1,
          vector: 2
        ]
    end
  end

  @doc "Defines a test that passes if its body, a `forall/2`, holds."
  defmacro property(name, opts \\ [], do: block) do
    quote do
      test unquote(name) do
        BB.Test.Prop.check(unquote(block), unquote(opts))
      end
    end
  end

  @doc "Returns the property that `body` is true for each value of the generator."
  defmacro forall({:<-, _, [pattern, generator]}, do: body) do
    quote do
      :proper.forall(unquote(generator), fn unquote(pattern) ->
        BB.Test.Prop.outcome(fn -> unquote(body) end)
      end)
    end
  end

  @doc "Generates atoms that exist already, so that a run does not fill the atom table."
  def atom, do: :proper_types.oneof([:a, :b, :c, :d, nil, true, false, :ok, :error, :some_atom])

  @doc "Generates the results of `fun` for the values of another generator."
  def map(generator, fun),
    do: :proper_types.bind(generator, &:proper_types.exactly(fun.(&1)), false)

  @doc "Generates the values of the generator that `fun` makes from a value of another."
  def bind(generator, fun), do: :proper_types.bind(generator, fun, false)

  @doc false
  def check(property, opts) do
    options = [
      :quiet,
      :long_result,
      numtests: opts[:numtests] || 100,
      max_shrinks: opts[:max_shrinks] || 500
    ]

    case :proper.quickcheck(property, options) do
      true ->
        :ok

      {:error, reason} ->
        raise ExUnit.AssertionError, message: "the property could not run: #{inspect(reason)}"

      counterexample ->
        raise ExUnit.AssertionError,
          message:
            "the property does not hold for:\n\n#{inspect(counterexample, pretty: true)}#{why()}"
    end
  end

  # Debian's PropEr reads a stack trace in a way that OTP no longer supports, so that no exception
  # may reach it.
  @doc false
  def outcome(body) do
    body.()
  catch
    kind, reason ->
      Process.put(__MODULE__, Exception.format(kind, reason, __STACKTRACE__))
      false
  end

  defp why do
    if text = Process.delete(__MODULE__), do: "\n\nThe last failure was:\n#{text}", else: ""
  end
end

if match?({:error, _}, :code.lib_dir(:localize)) do
  defmodule Localize.Unit do
    @moduledoc """
    The functions of `BB.Unit` under the name that drivers use, where the library Localize is
    absent.

        rate = Localize.Unit.new!(500, "millisecond")
        0.5 = Localize.Unit.convert!(rate, "second").value

    They take and return a `%BB.Unit{}`, the struct of `~u`. There is no struct of this name: two
    structs would never match each other, and a pattern of this one would fail in silence.
    """

    alias BB.Unit

    @doc "Creates a quantity. Returns `{:ok, unit}` or `{:error, exception}`."
    @spec new(number(), Unit.name()) :: {:ok, Unit.t()} | {:error, Exception.t()}
    defdelegate new(value, name), to: Unit

    @doc "Creates the quantity 1 of a unit."
    @spec new(Unit.name()) :: {:ok, Unit.t()} | {:error, Exception.t()}
    defdelegate new(name), to: Unit

    @doc "Creates a quantity, or raises."
    @spec new!(number(), Unit.name()) :: Unit.t()
    defdelegate new!(value, name), to: Unit

    @doc "Converts a quantity. Returns `{:ok, unit}` or `{:error, exception}`."
    @spec convert(Unit.t(), Unit.name()) :: {:ok, Unit.t()} | {:error, Exception.t()}
    defdelegate convert(unit, name), to: Unit

    @doc "Converts a quantity, or raises."
    @spec convert!(Unit.t(), Unit.name()) :: Unit.t()
    defdelegate convert!(unit, name), to: Unit

    @doc "Compares two quantities."
    @spec compare(Unit.t(), Unit.t()) :: :lt | :eq | :gt | {:error, Exception.t()}
    defdelegate compare(left, right), to: Unit

    @doc "Returns whether two units, or quantities, are of one kind."
    @spec compatible?(Unit.t() | Unit.name(), Unit.t() | Unit.name()) :: boolean()
    defdelegate compatible?(left, right), to: Unit

    @doc "Formats a quantity."
    @spec to_string!(Unit.t() | [Unit.t()], keyword()) :: String.t()
    defdelegate to_string!(unit, opts \\ []), to: Unit
  end
end

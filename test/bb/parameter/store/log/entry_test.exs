defmodule BB.Parameter.Store.Log.EntryTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils

  alias BB.Parameter.Store.Log.Entry

  doctest Entry

  property "a path and a value are read as they were written" do
    forall {path, value} <- {non_empty(list(atom())), any()} do
      assert path |> Entry.encode(value) |> Entry.decode() == {:ok, {path, value}}
    end
  end

  test "quantities are read as they were written" do
    value = [~u(1 hertz), ~u(2.5 meter)]
    assert [:a] |> Entry.encode(value) |> Entry.decode() == {:ok, {[:a], value}}
  end

  # The bytes of an atom that nobody has named yet.
  defp new_atom(name), do: <<131, 119, byte_size(name), name::binary>>

  test "an atom that this VM has not seen yet is read on request, in a path and in a value" do
    name = "never_seen_#{System.unique_integer([:positive])}"
    {key, data} = Entry.encode([:mode], :calm)

    for entry <- [{key, new_atom(name)}, {<<131, 108, 1::32, tail(name)::binary, 106>>, data}] do
      assert Entry.decode(entry) == :error
      assert {:ok, {[_], _}} = Entry.decode_new(entry)
      assert {:ok, {[_], _}} = Entry.decode(entry)
    end
  end

  defp tail(name), do: binary_part(new_atom(name <> "_path"), 1, byte_size(name) + 7)

  test "what is no term, no path or compressed is not read" do
    {key, value} = Entry.encode([:mode], :calm)
    {number, _} = Entry.encode([1], 1) |> then(fn {_, data} -> {data, nil} end)
    bomb = :erlang.term_to_binary(List.duplicate(0, 100_000), compressed: 9)

    for entry <- [{"", value}, {key, ""}, {key, "garbage"}, {number, value}, {key, bomb}],
        do: assert({Entry.decode(entry), Entry.decode_new(entry)} == {:error, :error})
  end
end

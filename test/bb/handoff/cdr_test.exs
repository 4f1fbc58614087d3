defmodule BB.Handoff.CdrTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Handoff.Cdr

  doctest BB.Handoff.Cdr
  doctest BB.Handoff.Encoding

  # Types with a value each, of any depth.
  defp typed do
    oneof([
      bind(integer(-0x8000_0000, 0x7FFF_FFFF), &{:i32, &1}),
      bind(integer(0, 0xFFFF_FFFF), &{:u32, &1}),
      bind(integer(0, 0xFFFF_FFFF_FFFF_FFFF), &{:u64, &1}),
      bind(float(), &{:f64, &1}),
      bind(list(integer(?a, ?z)), &{:string, List.to_string(&1)}),
      bind(list(float()), &{{:sequence, :f64}, &1}),
      bind(vector(3, integer(0, 9)), &{{:array, :u32, 3}, &1}),
      bind(
        list(integer(0, 9)),
        &{{:sequence, [:u32, :u64]}, Enum.map(&1, fn n -> [n, n * 1_000_000_007] end)}
      )
    ])
  end

  property "encoded values decode to themselves, whatever follows them" do
    forall {fields, rest} <- {list(typed()), binary()} do
      {types, values} = Enum.unzip(fields)
      bytes = IO.iodata_to_binary([Cdr.encode(types, values), rest])
      Cdr.decode(bytes, types) == {:ok, values}
    end
  end

  property "every number begins at a multiple of its size, counted after the header" do
    forall text <- list(integer(?a, ?z)) do
      <<_header::32, body::binary>> =
        IO.iodata_to_binary(Cdr.encode([:string, :u64], [List.to_string(text), 7]))

      rem(byte_size(body), 8) == 0 and binary_part(body, byte_size(body), -8) == <<7::little-64>>
    end
  end

  property "bytes that are cut short are an error" do
    forall fields <- list(typed()) do
      {types, values} = Enum.unzip(fields)
      bytes = IO.iodata_to_binary(Cdr.encode(types, values))
      cut = binary_part(bytes, 0, max(byte_size(bytes) - 1, 0))
      fields == [] or match?({:error, {:truncated, _}}, Cdr.decode(cut, types))
    end
  end

  property "any bytes decode or are an error, and nothing raises" do
    types = [:string, {:sequence, [:string, :f64]}, {:array, :f32, 3}]

    forall bytes <- binary() do
      case Cdr.decode(<<0, 1, 0, 0, bytes::binary>>, types) do
        {:ok, values} -> length(values) == 3
        {:error, _} -> true
      end
    end
  end

  test "a false count is an error, not an allocation" do
    assert {:error, {:truncated, _}} =
             Cdr.decode(<<0, 1, 0, 0, 0xFFFFFFFF::32>>, [{:sequence, :f64}])
  end

  test "a big-endian message and an empty one are distinct errors" do
    assert {:error, :not_little_endian_cdr} = Cdr.decode(<<0, 0, 0, 0, 1::32>>, [:u32])
    assert {:error, :not_little_endian_cdr} = Cdr.decode("", [:u32])
  end

  test "a number that is not finite is an error with its offset" do
    assert {:error, {:invalid, :f64, 0}} = Cdr.decode(<<0, 1, 0, 0, 0::48, 0xF07F::16>>, [:f64])
  end
end

defmodule BB.Error.Text do
  @moduledoc """
  Formats the fields of errors. The modules below `BB.Error` use it in `message/1`.

      iex> BB.Error.Text.text(%ArgumentError{message: "bad pin"})
      "bad pin"
  """

  @doc """
  Formats a value for a sentence: a text, a number and an atom as they are, an exception by its
  message, all else by `inspect/1`.

      iex> Enum.map(["overload", 3, :nack, nil, {:exit, 1}], &BB.Error.Text.text/1)
      ["overload", "3", "nack", "nil", "{:exit, 1}"]
  """
  @spec text(term()) :: String.t()
  def text(text) when is_binary(text), do: if(String.valid?(text), do: text, else: inspect(text))
  def text(%{__exception__: true} = error), do: Exception.message(error)
  def text(nil), do: "nil"
  def text(atom) when is_atom(atom), do: atom |> inspect() |> String.trim_leading(":")
  def text(value), do: inspect(value)

  @doc """
  Formats the command of an error and its actuator.

      iex> BB.Error.Text.command(%{command: :hold, actuator: :servo})
      "command :hold of actuator :servo"
  """
  @spec command(%{:command => term(), :actuator => term(), optional(atom()) => term()}) ::
          String.t()
  def command(%{command: command, actuator: actuator}),
    do: "command #{inspect(command)} of actuator #{inspect(actuator)}"

  @doc """
  Formats the robot of an error as the end of a sentence, which is empty without a robot.

      iex> BB.Error.Text.in_robot(%{robot: MyRobot})
      " in robot MyRobot"
  """
  @spec in_robot(%{:robot => term(), optional(atom()) => term()}) :: String.t()
  def in_robot(%{robot: nil}), do: ""
  def in_robot(%{robot: %{name: name}}), do: " in robot #{inspect(name)}"
  def in_robot(%{robot: robot}), do: " in robot #{inspect(robot)}"
end
